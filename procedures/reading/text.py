"""Text formats: JSON, TOML, CSV, and arrays of numbers, from files of a size that a person's text can have."""

from __future__ import annotations

import csv
import io
import json
import math
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from procedures.outcome import BadInput
from procedures.reading.arrays import Shape, checked_array
from procedures.reading.guard import Room, decoding, read_file

SPREAD = 30
"""Bytes in memory for each byte of text: a number of two letters becomes an object of 32 bytes in a list."""
LARGEST_WHOLE = 1 << 63
"""Whole numbers are below, as TOML has them (1.0.0, "Integer"): a larger one does not fit into a float or an array."""


def read_text(path: Path, kind: str, remedy: str, errors: str = "strict") -> str:
    """The text of a UTF-8 file, with or without its mark; `errors` as `bytes.decode` takes it. Raises BadInput."""
    return _text(read_file(path, kind), str(path), kind, remedy, errors)


def _text(data: bytes, name: str, kind: str, remedy: str, errors: str = "strict") -> str:
    Room(name).take(SPREAD * len(data), f"{len(data)} bytes of text")
    try:
        return data.decode("utf-8-sig", errors)
    except UnicodeDecodeError as error:
        raise BadInput(f"{kind} {name} cannot be read: it is not text", remedy) from error


def read_json(path: Path, remedy: str = "write it again") -> Any:
    """What a JSON file holds, its numbers finite. Raises BadInput."""
    return parse_json(read_file(path, "JSON file"), str(path), remedy)


def parse_json(data: bytes, name: str, remedy: str) -> Any:
    """What the bytes of a JSON file hold, for those who hash them too. Raises BadInput."""
    text = _text(data, name, "JSON file", remedy)
    with decoding(name, "JSON", remedy):
        content = json.loads(text, parse_constant=_refuse, parse_float=_finite)
        _check_whole_numbers(content)
        return content


def _refuse(word: str) -> NoReturn:
    raise ValueError(f"{word} is no finite number")


def _finite(word: str) -> float:
    number = float(word)
    return number if math.isfinite(number) else _refuse(word)


def _check_whole_numbers(content: object) -> None:
    """Raise ValueError where a whole number takes more than 64 bits."""
    if isinstance(content, dict | list):
        for one in content.values() if isinstance(content, dict) else content:
            _check_whole_numbers(one)
    elif isinstance(content, int) and not -LARGEST_WHOLE <= content < LARGEST_WHOLE:
        raise ValueError(f"whole numbers have up to 64 bits; got one of {content.bit_length()} bits")


def read_toml(path: Path, remedy: str = "correct it, or name another file") -> dict[str, Any]:
    """The tables of a TOML file. Raises BadInput."""
    return parse_toml(read_text(path, "TOML file", remedy), str(path), remedy)


def parse_toml(text: str, name: str, remedy: str) -> dict[str, Any]:
    """The tables of a text of TOML. Raises BadInput."""
    import tomllib  # it builds its grammar, which few commands need

    with decoding(name, "TOML", remedy):
        try:
            content = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise BadInput(f"{name} is no TOML: {error}", remedy) from error
        _check_whole_numbers(content)
        return content


def read_rows(path: Path, remedy: str) -> list[list[str]]:
    """The rows of a CSV file, cell by cell. Raises BadInput."""
    text = read_text(path, "CSV file", remedy)
    with decoding(str(path), "CSV", remedy):
        return list(csv.reader(io.StringIO(text, newline="")))


def read_numbers(
    path: Path, what: str, shape: Shape = (None, None), remedy: str = "give a text array of numbers"
) -> npt.NDArray[np.float64]:
    """A text array, a row per line, `#` before comments: (rows, columns). Raises BadInput as `checked_array`."""
    text = read_text(path, what, remedy)
    with decoding(str(path), what, remedy):
        rows = [[float(word) for word in words] for line in text.splitlines() if (words := line.split("#")[0].split())]
    return checked_array(rows, f"{what} {path}", shape, remedy=remedy)
