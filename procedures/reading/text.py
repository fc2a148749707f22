"""Text formats, JSON, TOML, CSV and arrays of numbers, with a limit of memory."""

import csv
import io
import json
import math
from pathlib import Path
from typing import Any, NoReturn

from procedures.numerics.arrays import Array
from procedures.outcome import BadInput
from procedures.reading.arrays import Shape, checked_array
from procedures.reading.guard import Room, decoding, read_file

BYTES_PER_BYTE = 30
"""Bytes in memory per byte of text: a number of two characters becomes an object of 32 bytes in a list."""
LARGEST_WHOLE = 1 << 63  # limit of integers, as in TOML 1.0.0 ("Integer"): larger ones do not fit into an array


def read_text(path: Path, kind: str, remedy: str, errors: str = "strict") -> str:
    """Read a UTF-8 file, with or without a byte order mark; `errors` as in `bytes.decode`. Raises BadInput."""
    return _text(read_file(path, kind), str(path), kind, remedy, errors)


def _text(data: bytes, name: str, kind: str, remedy: str, errors: str = "strict") -> str:
    Room(name).take(BYTES_PER_BYTE * len(data), f"{len(data)} bytes of text")
    try:
        return data.decode("utf-8-sig", errors)
    except UnicodeDecodeError as error:
        raise BadInput(f"{kind} {name} must be UTF-8 text; it is not", remedy) from error


def read_json(path: Path, remedy: str = "write it again") -> Any:
    """Content of a JSON file with finite numbers. Raises BadInput."""
    return parse_json(read_file(path, "JSON file"), str(path), remedy)


def parse_json(data: bytes, name: str, remedy: str) -> Any:
    """Content of the bytes of a JSON file. Raises BadInput."""
    text = _text(data, name, "JSON file", remedy)
    with decoding(name, "JSON", remedy):
        content = json.loads(text, parse_constant=_refuse, parse_float=_finite)
        _check_whole_numbers(content)
        return content


def _refuse(word: str) -> NoReturn:
    raise ValueError(f"{word} is not a finite number")


def _finite(word: str) -> float:
    number = float(word)
    return number if math.isfinite(number) else _refuse(word)


def _check_whole_numbers(content: object) -> None:
    """Raise ValueError for integers of more than 64 bits."""
    if isinstance(content, dict | list):
        for one in content.values() if isinstance(content, dict) else content:
            _check_whole_numbers(one)
    elif isinstance(content, int) and not -LARGEST_WHOLE <= content < LARGEST_WHOLE:
        raise ValueError(f"integers must have at most 64 bits; got {content.bit_length()}")


def read_toml(path: Path, remedy: str = "correct it, or name another file") -> dict[str, Any]:
    """Tables of a TOML file. Raises BadInput."""
    return parse_toml(read_text(path, "TOML file", remedy), str(path), remedy)


def parse_toml(text: str, name: str, remedy: str) -> dict[str, Any]:
    """Tables of a TOML text. Raises BadInput."""
    import tomllib  # slow to import, and needed by few commands

    with decoding(name, "TOML", remedy):
        try:
            content = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise BadInput(f"{name} is not valid TOML: {error}", remedy) from error
        _check_whole_numbers(content)
        return content


def read_rows(path: Path, remedy: str) -> list[list[str]]:
    """Rows of a CSV file, cell by cell. Raises BadInput."""
    text = read_text(path, "CSV file", remedy)
    with decoding(str(path), "CSV", remedy):
        return list(csv.reader(io.StringIO(text, newline="")))


def read_numbers(path: Path, what: str, shape: Shape = (None, None)) -> Array:
    """Read a text array (rows, columns), a row per line, `#` before comments. Raises BadInput as `checked_array`."""
    remedy = "give a text array of numbers"
    text = read_text(path, what, remedy)
    with decoding(str(path), what, remedy):
        rows = [[float(word) for word in words] for line in text.splitlines() if (words := line.split("#")[0].split())]
    return checked_array(rows, f"{what} {path}", shape, remedy=remedy)
