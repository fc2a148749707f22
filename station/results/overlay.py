"""The MTF of another result, drawn over one's own: read from the tables beside its record. A field's result has two:
the MTF at the frame's centre over frequency, and at some frequencies over image height."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from procedures.numerics.arrays import Array
from procedures.outcome import BadParameter
from procedures.reading.text import read_rows
from station.common.sanitise import printable
from station.results.result_files import RECORD
from station.results.units import Unit, unit_in

REMEDY = "name the folder of a result of station psf or station mtf, or a session with one"


@dataclass(frozen=True, eq=False)
class Overlay:
    """The curves of another result.

    name : for a legend
    unit : of its frequencies
    planes : columns of (n,) by plane: frequency, and horizontal and vertical, or mtf across an edge; over image height
        image_height, frequency, sagittal and meridional, a row for each height and frequency
    length : "mm" or "pixel", the unit of image heights; empty for an MTF over frequency
    """

    name: str
    unit: Unit
    planes: Mapping[str, Mapping[str, Array]]
    length: str = ""

    def of(self, plane: str, unit: Unit, length: str = "") -> Mapping[str, Array]:
        """The curves of a plane; none without this plane or with heights in another unit. Raises as `check`."""
        self.check(unit)
        return self.planes.get(plane, {}) if self.length == length else {}

    def check(self, unit: Unit) -> None:
        """Raise BadParameter if its frequencies are in another unit."""
        if self.unit != unit:
            raise BadParameter(f"{self.name} gives its MTF in {self.unit}, and this result in {unit}",
                               f"add --unit {self.unit}")  # fmt: skip


def read_overlay(path: Path) -> Overlay:
    """The MTF over frequency of the result in a folder, or of the newest result of a session. Raises BadParameter."""
    return _read(path, "mtf", ("frequency",), "an MTF")


def read_height_overlay(path: Path) -> Overlay:
    """The MTF over image height of the field in a folder, or of the newest of a session. Raises BadParameter."""
    return _read(path, "heights", ("image_height", "frequency"), "an MTF over image height")


def read_height_overlays(paths: Iterable[Path], unit: Unit) -> list[Overlay]:
    """Several of the same unit of frequencies. Raises BadParameter."""
    overlays = [read_height_overlay(path) for path in paths]
    for overlay in overlays:
        overlay.check(unit)
    return overlays


def _read(path: Path, stem: str, first: Sequence[str], words: str) -> Overlay:
    """The tables of one kind of a result; `first` are the columns they begin with."""
    results = sorted(path.glob(f"derived/*/{RECORD}"), key=lambda one: (len(one.parent.name), one.parent.name))
    folder = results[-1].parent if results else path
    tables = sorted(folder.glob(f"{stem}_*.csv"))
    if not (folder / RECORD).is_file() or not tables:
        raise BadParameter(f"{printable(path)} has no result with {words} to draw over this one's", REMEDY)
    heads, planes = set(), {}
    for table in tables:
        try:
            units, planes[table.stem.removeprefix(f"{stem}_")] = table_columns(read_rows(table, REMEDY), first)
        except ValueError as error:
            raise BadParameter(f"{printable(table)} is no table of {words}", REMEDY) from error
        heads.add(tuple(units[: len(first)]))
    if len(heads) > 1:
        raise BadParameter(f"{printable(path)} gives its planes in several units", REMEDY)
    (*lengths, frequency) = heads.pop()
    return Overlay(printable(path.name or path), unit_in(frequency), planes, "".join(lengths))


def table_columns(rows: Sequence[Sequence[str]], first: Sequence[str]) -> tuple[list[str], dict[str, Array]]:
    """Units and columns (n,) of a table headed `name [unit]`. Raises ValueError without the columns `first`, or for no
    number."""
    head, *cells = rows or [[]]
    names, units = [one.partition(" [")[0] for one in head], [one.partition("[")[2].rstrip("]") for one in head]
    values = np.array([[float(cell) for cell in row] for row in cells], dtype=np.float64)
    if names[: len(first)] != list(first) or not len(values) or not np.isfinite(values).all():
        raise ValueError(f"columns {', '.join(first)} of finite numbers are required")
    return units, dict(zip(names, values.T, strict=True))
