"""Results read back from their folders: verdicts, numbers, PSF and MTF of each plane, and two beside each other."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.outcome import BadInput, Quantity, Verdict
from procedures.reading.arrays import checked_array, parse_npy
from procedures.reading.text import parse_json
from station.common.durable_files import read_own
from station.results.plane_result import PlaneResult
from station.results.record_head import read_other_causes
from station.results.restored import RESTORATION, Restored, read_restored
from station.results.result_files import RECORD
from station.results.terms import comparison_of
from station.results.units import Unit

Array = npt.NDArray[np.float64]

DIRECTIONS = ("horizontal", "vertical", "radial")
_AGAIN = "recompute the session"
PLANE_LETTERS = 8
"""Plane names longer than this are of no camera; they would also be file names."""


@dataclass(frozen=True, eq=False)
class ReadResult:
    """A result as its folder tells it: its planes, or what was restored."""

    folder: Path
    procedure: str
    planes: Mapping[str, PlaneResult]
    restored: Restored | None = None


def read_result(folder: Path) -> ReadResult:
    """The result in a folder. Raises BadInput, naming what is missing or damaged."""
    record = _record(folder / RECORD)
    if record.get("schema") == RESTORATION:
        return ReadResult(folder, str(record.get("procedure", "")), {}, read_restored(folder, record))
    entries = record.get("planes")
    if not isinstance(entries, dict) or not all(_is_plane(name, entry) for name, entry in entries.items()):
        raise BadInput(f"{folder / RECORD} names no planes", _AGAIN)
    planes = {name: _plane(folder, name, entry) for name, entry in entries.items()}
    return ReadResult(folder, str(record.get("procedure", "")), planes)


def find_results(sessions: Path) -> list[Path]:
    """The folders of all results under a folder of sessions, newest first."""
    found = [record.parent for record in sessions.glob(f"*/derived/*/{RECORD}") if not record.parent.is_symlink()]
    return sorted(found, key=lambda folder: (folder / RECORD).lstat().st_mtime, reverse=True)


def _record(path: Path) -> dict[str, Any]:
    record = parse_json(_own(path), str(path), _AGAIN)
    if not isinstance(record, dict):
        raise BadInput(f"{path} is no record of a result", _AGAIN)
    return record


def _is_plane(name: str, entry: object) -> bool:
    return name.isalnum() and len(name) <= PLANE_LETTERS and isinstance(entry, dict)


def _plane(folder: Path, name: str, entry: Mapping[str, Any]) -> PlaneResult:
    try:
        verdict = Verdict(entry.get("verdict", ""))
    except ValueError as error:
        raise BadInput(f"{folder / RECORD}: plane {name} has no verdict", _AGAIN) from error
    numbers = {key: found for key, value in entry.items() if (found := _quantity(value)) is not None}
    reason, remedy = str(entry.get("reason", "")), str(entry.get("remedy", ""))
    refused = verdict is Verdict.REFUSED
    h = None if refused else _samples(folder / f"psf_{name}.npy")
    mtf = {} if refused else _columns(folder / f"mtf_{name}.csv")
    return PlaneResult(
        name, verdict, reason, remedy, numbers, mtf, h, unit=_unit(folder / f"mtf_{name}.csv", mtf),
        specification=comparison_of(entry), other_causes=read_other_causes(entry),
    )  # fmt: skip


def _unit(path: Path, curves: Mapping[str, Array]) -> Unit:
    """The unit that a table of an MTF tells in its heading; that of earlier tables, which told none."""
    head = read_own(path).decode().partition("\n")[0] if curves else ""
    return next((one for one in Unit if f"[{one}]" in head), Unit.CYCLES)


def _quantity(value: object) -> Quantity | None:
    if not isinstance(value, dict) or not {"value", "unit", "uncertainty"} <= value.keys():
        return None
    number, uncertainty = (_number(value[key]) for key in ("value", "uncertainty"))
    return Quantity(number, str(value["unit"]), uncertainty, str(value.get("method", "")), _count(value.get("n", 0)))


def _number(value: object) -> float:
    try:
        return float(value) if isinstance(value, int | float) else math.nan
    except OverflowError:
        return math.nan


def _count(value: object) -> int:
    number = _number(value)
    return int(number) if math.isfinite(number) else 0


def _samples(path: Path) -> Array:
    return checked_array(parse_npy(_own(path), str(path), _AGAIN), f"the PSF {path}", ("k", "k"), remedy=_AGAIN)


def _own(path: Path) -> bytes:
    try:
        return read_own(path)
    except OSError as error:
        raise BadInput(f"{path} cannot be read: {error}", _AGAIN) from error


def _columns(path: Path) -> dict[str, Array]:
    try:
        names, *rows = read_own(path).decode().replace(" [", "[").split()
        table = np.array([[float(word) for word in row.split(",")] for row in rows], dtype=np.float64)
        columns = dict(zip((name.partition("[")[0] for name in names.split(",")), table.T, strict=True))
    except (OSError, ValueError) as error:
        raise BadInput(f"{path} cannot be read: {error}", _AGAIN) from error
    shown = [columns.get(name, np.array([np.nan])) for name in ("frequency", *DIRECTIONS)]
    if not all(column.size and np.isfinite(column).all() for column in shown) or shown[0].max() <= 0:
        raise BadInput(f"{path} is no table of an MTF", _AGAIN)
    return columns


# --- two results side by side ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Change:
    """One number in two results."""

    name: str
    one: Quantity
    other: Quantity

    @property
    def sigmas(self) -> float:
        """Other less one, in standard uncertainties of the difference; NaN where both are exact."""
        spread = math.hypot(self.one.uncertainty, self.other.uncertainty)
        return (self.other.value - self.one.value) / spread if spread > 0 else math.nan


def changes(one: PlaneResult, other: PlaneResult) -> list[Change]:
    """The numbers that both have."""
    return [Change(name, value, other.numbers[name]) for name, value in one.numbers.items() if name in other.numbers]
