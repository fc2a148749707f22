"""Tables as TOML text; the standard library can only read it."""

import bisect
import contextlib
import json
import math
import re
import tomllib
from collections.abc import Mapping
from datetime import date, datetime, time
from typing import Any

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def toml_text(table: Mapping[str, Any]) -> str:
    """The table as TOML, subtables as sections, None omitted, surrogates, which UTF-8 lacks, as "?". Raises TypeError
    for values without a form."""
    return "".join(_section(table, ()))


def _section(table: Mapping[str, Any], path: tuple[str, ...]) -> list[str]:
    text = [
        f"{_key(name)} = {toml_value(value)}\n"
        for name, value in table.items()
        if not (value is None or isinstance(value, Mapping))
    ]
    if path and (text or not any(isinstance(value, Mapping) for value in table.values())):
        text.insert(0, f"\n[{'.'.join(_key(part) for part in path)}]\n")
    for name, value in table.items():
        if isinstance(value, Mapping):
            text += _section(value, (*path, name))
    return text


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


KeyPath = tuple[str | int, ...]
"""Keys, and indices within lists, from the root."""
CLOSINGS = ("", "]", "}]", "]]", '"""', "'''")
"""The text that completes a file that is cut off at the end of a line."""


def line_of(text: str, path: KeyPath) -> int | None:
    """The line of valid TOML, counted from 1, on which a key begins, or else its nearest ancestor that is there. That
    line is the first one whose addition makes the key a part of what Python reads."""
    lines, whole = text.split("\n"), tomllib.loads(text)
    there = next((path[:n] for n in range(len(path), 0, -1) if _has(whole, path[:n])), None)
    if there is None:
        return None

    def begun(number: int) -> bool:
        for closing in CLOSINGS:
            with contextlib.suppress(tomllib.TOMLDecodeError):
                return _has(tomllib.loads("\n".join((*lines[:number], closing))), there)
        return False

    return 1 + bisect.bisect_left(range(1, len(lines)), True, key=begun)


def _has(table: Any, path: KeyPath) -> bool:
    for part in path:
        if not (0 <= part < len(table) if isinstance(table, list) and isinstance(part, int) else part in table):
            return False
        table = table[part]
    return True
