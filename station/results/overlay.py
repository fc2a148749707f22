"""The MTF of another result, drawn over one's own: read from the tables beside its record.

A field's result has two: the MTF at the frame's centre over frequency, and at some frequencies over image height.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from procedures.outcome import BadParameter
from procedures.reading.text import read_rows
from station.common.sanitise import printable
from station.results.result_files import RECORD
from station.results.units import Unit

Array = npt.NDArray[np.float64]
REMEDY = "name the folder of a result of station psf or station mtf, or a session with one"


@dataclass(frozen=True, eq=False)
class Overlay:
    """The curves of another result.

    Attributes
    ----------
    name : what a legend calls it
    unit : of its frequencies
    planes : by name of the plane, columns of (n,): frequency, and horizontal and vertical, or mtf across an edge
    """

    name: str
    unit: Unit
    planes: Mapping[str, Mapping[str, Array]]

    def of(self, plane: str, unit: Unit) -> Mapping[str, Array]:
        """The curves of a plane; none where it has not that plane. Raises BadParameter where its unit is another."""
        _check_unit(self.name, self.unit, unit)
        return self.planes.get(plane, {})


@dataclass(frozen=True, eq=False)
class HeightOverlay:
    """The curves over image height of another field.

    Attributes
    ----------
    name : what a legend calls it
    unit : of its frequencies
    length : "mm" or "pixel", of its heights
    planes : by name of the plane, columns of (n,): image_height, frequency, sagittal, meridional and what is told of
        these; a row for each height and frequency
    """

    name: str
    unit: Unit
    length: str
    planes: Mapping[str, Mapping[str, Array]]

    def of(self, plane: str, length: str) -> Mapping[str, Array]:
        """The curves of a plane; none where it has not that plane, or tells heights in another unit."""
        return self.planes.get(plane, {}) if self.length == length else {}


def _check_unit(name: str, theirs: Unit, own: Unit) -> None:
    if theirs != own:
        raise BadParameter(f"{name} gives its MTF in {theirs}, and this result in {own}", f"add --unit {theirs}")


def read_overlay(path: Path) -> Overlay:
    """The curves of the result in a folder; of a session's, those of its newest result.

    Raises
    ------
    BadParameter
        If there is no such result, or it has no table of an MTF.
    """
    read = _tables(path, "mtf", "frequency", "an MTF")
    (unit,) = _units(path, (heads[0] for heads, _ in read.values()))
    return Overlay(printable(path.name or path), unit, {name: columns for name, (_, columns) in read.items()})


def read_height_overlay(path: Path) -> HeightOverlay:
    """The curves over image height of the field in a folder; of a session's, those of its newest result.

    Raises
    ------
    BadParameter
        If there is no such result, or it is none of a field.
    """
    read = _tables(path, "heights", "image_height", "an MTF over image height")
    (unit,) = _units(path, (heads[1] for heads, _ in read.values()))
    lengths = {heads[0].partition("[")[2].rstrip("]") for heads, _ in read.values()}
    if len(lengths) > 1:
        raise BadParameter(f"{printable(path)} gives its planes in several units", REMEDY)
    columns = {name: columns for name, (_, columns) in read.items()}
    return HeightOverlay(printable(path.name or path), unit, lengths.pop(), columns)


def read_height_overlays(paths: Iterable[Path], unit: Unit) -> list[HeightOverlay]:
    """Several, before the work that they are drawn over. Raises BadParameter, also of frequencies in another unit."""
    found = [read_height_overlay(path) for path in paths]
    for one in found:
        _check_unit(one.name, one.unit, unit)
    return found


def _tables(path: Path, stem: str, first: str, words: str) -> dict[str, tuple[list[str], dict[str, Array]]]:
    """By plane the headings and columns of a result's tables of one kind. Raises BadParameter where there is none."""
    results = sorted(path.glob(f"derived/*/{RECORD}"), key=lambda one: (len(one.parent.name), one.parent.name))
    folder = results[-1].parent if results else path
    tables = {table.stem.removeprefix(f"{stem}_"): table for table in sorted(folder.glob(f"{stem}_*.csv"))}
    if not (folder / RECORD).is_file() or not tables:
        raise BadParameter(f"{printable(path)} has no result with {words} to draw over this one's", REMEDY)
    return {name: _columns(table, first, words) for name, table in tables.items()}


def _units(path: Path, heads: Iterable[str]) -> set[Unit]:
    """The one unit that the headings tell. Raises BadParameter where there are several."""
    units = {next((one for one in Unit if f"[{one}]" in head), Unit.CYCLES) for head in heads}
    if len(units) > 1:
        raise BadParameter(f"{printable(path)} gives its planes in several units", REMEDY)
    return units


def _columns(table: Path, first: str, words: str) -> tuple[list[str], dict[str, Array]]:
    """The headings, and the columns by the words before their units. Raises BadParameter."""
    head, *rows = read_rows(table, REMEDY) or [[]]
    try:
        values = np.array([[float(cell) for cell in row] for row in rows], dtype=np.float64)
        columns = dict(zip((name.partition(" [")[0] for name in head), values.T, strict=True))
    except ValueError as error:
        raise BadParameter(f"{printable(table)} is no table of {words}", REMEDY) from error
    if not {first, "frequency"} <= columns.keys() or not np.isfinite(values).all():
        raise BadParameter(f"{printable(table)} is no table of {words}", REMEDY)
    return list(head), columns
