"""Codes that devices send, with reason and remedy: the tables of `codes.csv`."""

from __future__ import annotations

import csv
from functools import cache
from importlib.resources import files


@cache
def _rows() -> list[list[str]]:
    return list(csv.reader(files(__package__).joinpath("codes.csv").read_text("utf-8").splitlines()))


def codes(table: str) -> dict[str, tuple[str, str]]:
    """Reason and remedy by code."""
    return {code: (reason, remedy) for name, code, reason, remedy in _rows() if name == table}


def numbered(table: str) -> dict[int, tuple[str, str]]:
    """Reason and remedy by number."""
    return {int(code): words for code, words in codes(table).items()}
