"""TOML that a person wrote, read key by key: a wrong type and an unknown key are named, with the nearest known one."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Self, TypeVar

from procedures.outcome import BadInput, BadParameter
from procedures.reading.text import parse_toml, read_toml
from station.common.sanitise import printable

T = TypeVar("T")

_WORDS = {
    float: "a number",
    int: "a whole number",
    bool: "true or false",
    str: "text in quotes",
    list: "a list in [ ]",
    dict: "a table",
}


MOST_NAMED = 12
"""Known keys that an error lists."""


class Table:
    """One table of a file: what is asked for is known, the rest is refused by `end`."""

    def __init__(self, content: Mapping[str, Any], where: str = "") -> None:
        self._content = content
        self._where = where
        self._known: list[str] = []

    @classmethod
    def read(cls, path: Path) -> Self:
        """The whole file. Raises BadParameter if it cannot be read."""
        try:
            return cls(read_toml(path))
        except BadInput as error:
            reason = f"{printable(path)} must be a TOML file: {printable(error.reason)}"
            raise BadParameter(reason, "correct it, or name another file") from error

    @classmethod
    def parse(cls, text: str, name: str) -> Self:
        """The whole of a file's text; `name` is the file's. Raises BadParameter if it is no TOML."""
        try:
            return cls(parse_toml(text, name, "correct it"))
        except BadInput as error:
            reason = f"{printable(name)} must be a TOML file: {printable(error.reason)}"
            raise BadParameter(reason, "correct it, or name another file") from error

    def get(self, key: str, kind: type[T], default: T) -> T:
        """The value of a key, of this type; a whole number passes for a number. Raises BadParameter."""
        self._known.append(key)
        value = self._content.get(key, default)
        if kind is float and type(value) is int:
            value = float(value)
        if type(value) is not kind or (isinstance(value, float) and math.isnan(value)):
            raise self.wrong(key, f"must be {_WORDS[kind]}; it is {printable(value)!r}")
        return value

    def number_or(self, key: str, word: str, default: int | None) -> int | None:
        """A whole number, or None for a word that stands for none. Raises BadParameter."""
        self._known.append(key)
        value = self._content.get(key, default)
        if value is None or value == word:
            return None
        if type(value) is not int:
            raise self.wrong(key, f'must be a whole number or "{word}"; it is {printable(value)!r}')
        return value

    def has(self, key: str) -> bool:
        """Whether the key is there."""
        self._known.append(key)
        return key in self._content

    def table(self, key: str) -> Table:
        """The table under a key; an empty one where it is not there."""
        return Table(self.get(key, dict, {}), f"{self._where}{key}.")

    def tables(self, known: Iterable[str]) -> dict[str, Table]:
        """All tables in here, whose names must be known ones."""
        self._known += known
        self.end()
        return {key: self.table(key) for key in self._content}

    def peek(self, key: str) -> object:
        """What stands under a key, whatever it is; None where nothing does."""
        return self._content.get(key)

    def list_of_tables(self, key: str) -> list[Table]:
        """The tables of an array; none where it is not there."""
        found = self.get(key, list, [])
        if not all(isinstance(one, dict) for one in found):
            raise self.wrong(key, f"must be tables: write [[{key}]]")
        return [Table(one, f"{self._where}{key}[{number}].") for number, one in enumerate(found, 1)]

    def words(self, key: str) -> tuple[str, ...]:
        """A list of texts; empty where it is not there."""
        found = self.get(key, list, [])
        if not all(isinstance(one, str) for one in found):
            raise self.wrong(key, "must be a list of texts in quotes")
        return tuple(found)

    def numbers(self, key: str) -> tuple[float, ...]:
        """A list of finite numbers, none of them negative; empty where it is not there."""
        found = self.get(key, list, [])
        if not all(type(one) in (int, float) and 0 <= one < math.inf for one in found):
            raise self.wrong(key, "must be a list of numbers that are not negative")
        return tuple(float(one) for one in found)

    def end(self) -> None:
        """Raise BadParameter if the table has a key that nobody asked for."""
        for key in self._content:
            if key not in self._known:
                near = get_close_matches(key, self._known, 1)
                known = sorted(set(self._known))
                more = f" and {len(known) - MOST_NAMED} more" if len(known) > MOST_NAMED else ""
                others = f"use one of {', '.join(known[:MOST_NAMED])}{more}"
                raise self.wrong(key, "is not known", f"write {near[0]}" if near else others)

    def wrong(self, key: str, words: str, remedy: str = "correct the procedure file") -> BadParameter:
        """An error about a key."""
        return BadParameter(f"{self._where}{printable(key)} {words}", remedy)
