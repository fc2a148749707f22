"""Tables as TOML text; the standard library can only read it."""

import json
import math
import re
from collections.abc import Mapping
from datetime import date, datetime, time
from typing import Any

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def toml_text(table: Mapping[str, Any]) -> str:
    """The table as TOML, subtables as sections, None omitted, surrogates, which UTF-8 lacks, as "?". Raises TypeError
    for values without a form."""
    return "".join(_section(table, ()))


def _section(table: Mapping[str, Any], path: tuple[str, ...]) -> list[str]:
    text = [f"{_key(name)} = {toml_value(value)}\n" for name, value in table.items() if not _skipped(value)]
    if path and (text or not any(isinstance(value, Mapping) for value in table.values())):
        text.insert(0, f"\n[{'.'.join(_key(part) for part in path)}]\n")
    for name, value in table.items():
        if isinstance(value, Mapping):
            text += _section(value, (*path, name))
    return text


def _skipped(value: Any) -> bool:
    return value is None or isinstance(value, Mapping)


def toml_value(value: Any) -> str:
    """One value as written in a file. Raises TypeError if it has no form in TOML."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(int(value))
    if isinstance(value, float):
        return repr(float(value)) if math.isfinite(value) else str(float(value))
    if isinstance(value, str):
        return _quoted(value)
    if isinstance(value, datetime | date | time):
        return value.isoformat()
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_key(k)} = {toml_value(v)}" for k, v in value.items() if v is not None) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml_value(part) for part in value) + "]"
    raise TypeError(f"TOML has numbers, text, dates, lists and tables, but no {type(value).__name__}")


def _key(text: str) -> str:
    return text if _BARE.fullmatch(text) else _quoted(text)


def _quoted(text: str) -> str:
    whole = text.encode("utf-8", "replace").decode()
    return json.dumps(whole, ensure_ascii=False).replace("\x7f", "\\u007f")


# --- Line numbers of the keys of a TOML file, which Python's own parser does not give ---

Path = tuple[str | int, ...]
"""Keys, and indices within lists, from the root."""
QUOTES = ('"""', "'''", '"', "'")


def key_lines(text: str) -> dict[Path, int]:
    """The line, counted from 1, of every key, table and list element of valid TOML."""
    return _Scanner(text.replace("\r\n", "\n")).scan()


def line_of(lines: Mapping[Path, int], path: Path) -> int | None:
    """The line of a key, or of its nearest ancestor that has one."""
    return next((lines[path[:n]] for n in range(len(path), 0, -1) if path[:n] in lines), None)


class _Scanner:
    """Scans the text once."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._at = 0
        self._lines: dict[Path, int] = {}
        self._counts: dict[Path, int] = {}

    def scan(self) -> dict[Path, int]:
        table: Path = ()
        while self._skip():
            if self._peek("["):
                table = self._header()
            else:
                self._pair(table)
        return self._lines

    def _skip(self) -> bool:
        """Skip spaces, line ends and comments; returns whether anything follows."""
        while self._at < len(self._text) and self._text[self._at] in " \t\n#,":
            if self._text[self._at] == "#":
                self._at = (self._text + "\n").index("\n", self._at)
            else:
                self._at += 1
        return self._at < len(self._text)

    def _peek(self, start: str) -> bool:
        return self._text.startswith(start, self._at)

    def _note(self, path: Path) -> None:
        self._lines.setdefault(path, self._text.count("\n", 0, self._at) + 1)

    def _header(self) -> Path:
        many = self._peek("[[")
        start, self._at = self._at, self._at + 1 + many
        path = self._key()
        if many:
            self._counts[path] = self._counts.get(path, -1) + 1
            path = (*path, self._counts[path])
        end, self._at = self._at, start
        self._note(path)
        self._at = self._text.index("]", end) + 1 + many
        return path

    def _key(self) -> Path:
        """A dotted key, up to what follows it."""
        parts: list[str | int] = []
        while True:
            self._spaces()
            parts.append(self._string() if self._text[self._at] in "\"'" else self._bare())
            self._spaces()
            if not self._peek("."):
                return tuple(parts)
            self._at += 1

    def _spaces(self) -> None:
        while self._text[self._at : self._at + 1] in (" ", "\t"):
            self._at += 1

    def _bare(self) -> str:
        start = self._at
        while self._text[self._at : self._at + 1] not in ("", ".", "=", "]", " ", "\t"):
            self._at += 1
        return self._text[start : self._at]

    def _string(self) -> str:
        quote = next(one for one in QUOTES if self._peek(one))
        self._at += len(quote)
        start = self._at
        while not self._peek(quote):
            self._at += 2 if quote[0] == '"' and self._peek("\\") else 1
        self._at += len(quote)
        return self._text[start : self._at - len(quote)]

    def _pair(self, table: Path) -> None:
        start = self._at
        path = (*table, *self._key())
        end, self._at = self._at, start
        self._note(path)
        self._at = self._text.index("=", end) + 1
        self._spaces()
        self._value(path)

    def _value(self, path: Path) -> None:
        if self._peek("["):
            self._list(path)
        elif self._peek("{"):
            self._at += 1
            while self._skip() and not self._peek("}"):
                self._pair(path)
            self._at += 1
        elif self._text[self._at] in "\"'":
            self._string()
        else:
            while self._text[self._at : self._at + 1] not in ("", "\n", ",", "]", "}", "#"):
                self._at += 1

    def _list(self, path: Path) -> None:
        self._at += 1
        number = 0
        while self._skip() and not self._peek("]"):
            self._note((*path, number))
            self._value((*path, number))
            number += 1
        self._at += 1
