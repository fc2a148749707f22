"""TOML files read key by key: wrong types and unknown keys are errors, which name the nearest known key."""

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
"""Number of known keys that an error lists."""


class Table:
    """One table of a file: keys that are read become known, others are refused by `end`."""

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
        """The whole of a file's text; `name` is the file's. Raises BadParameter if it is not TOML."""
        try:
            return cls(parse_toml(text, name, "correct it"))
        except BadInput as error:
            reason = f"{printable(name)} must be a TOML file: {printable(error.reason)}"
            raise BadParameter(reason, "correct it, or name another file") from error

    def get(self, key: str, kind: type[T], default: T) -> T:
        """The value of a key, of this type; an integer is accepted as a number. Raises BadParameter."""
        self._known.append(key)
        value = self._content.get(key, default)
        if kind is float and type(value) is int:
            value = float(value)
        if type(value) is not kind or (isinstance(value, float) and math.isnan(value)):
            raise self.wrong(key, f"must be {_WORDS[kind]}; it is {printable(value)!r}")
        return value

    def has(self, key: str) -> bool:
        """Whether the key exists."""
        self._known.append(key)
        return key in self._content

    def table(self, key: str) -> Table:
        """The table under a key; empty if absent."""
        return Table(self.get(key, dict, {}), f"{self._where}{key}.")

    def tables(self, known: Iterable[str]) -> dict[str, Table]:
        """All tables in this one, whose names must be known."""
        self._known += known
        self.end()
        return {key: self.table(key) for key in self._content}

    def peek(self, key: str) -> object:
        """The value of a key, of any type; None if absent."""
        return self._content.get(key)

    def list_of_tables(self, key: str) -> list[Table]:
        """The tables of an array; empty if absent."""
        rows = self.get(key, list, [])
        if not all(isinstance(row, dict) for row in rows):
            raise self.wrong(key, f"must be tables: write [[{key}]]")
        return [Table(row, f"{self._where}{key}[{number}].") for number, row in enumerate(rows, 1)]

    def words(self, key: str) -> tuple[str, ...]:
        """A list of texts; empty if absent."""
        texts = self.get(key, list, [])
        if not all(isinstance(text, str) for text in texts):
            raise self.wrong(key, "must be a list of texts in quotes")
        return tuple(texts)

    def numbers(self, key: str) -> tuple[float, ...]:
        """A list of finite non-negative numbers; empty if absent."""
        numbers = self.get(key, list, [])
        if not all(type(number) in (int, float) and 0 <= number < math.inf for number in numbers):
            raise self.wrong(key, "must be a list of numbers that are not negative")
        return tuple(float(number) for number in numbers)

    def end(self) -> None:
        """Raise BadParameter if the table has a key that was not read."""
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
