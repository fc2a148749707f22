"""The MTF of another result, drawn over one's own: read from the tables beside its record."""

from __future__ import annotations

from collections.abc import Mapping
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
        if self.unit != unit:
            reason = f"{self.name} tells its MTF in {self.unit}, and this result in {unit}"
            raise BadParameter(reason, f"add --unit {self.unit}")
        return self.planes.get(plane, {})


def read_overlay(path: Path) -> Overlay:
    """The curves of the result in a folder; of a session's, those of its newest result.

    Raises
    ------
    BadParameter
        If there is no such result, or it has no table of an MTF.
    """
    results = sorted(path.glob(f"derived/*/{RECORD}"), key=lambda one: (len(one.parent.name), one.parent.name))
    folder = results[-1].parent if results else path
    tables = {table.stem.removeprefix("mtf_"): table for table in sorted(folder.glob("mtf_*.csv"))}
    if not (folder / RECORD).is_file() or not tables:
        raise BadParameter(f"{printable(path)} has no result with an MTF to draw over this one's", REMEDY)
    read = {name: _columns(table) for name, table in tables.items()}
    units = {unit for unit, _ in read.values()}
    if len(units) > 1:
        raise BadParameter(f"{printable(folder)} tells its planes in several units", REMEDY)
    return Overlay(printable(path.name or path), units.pop(), {name: columns for name, (_, columns) in read.items()})


def _columns(table: Path) -> tuple[Unit, dict[str, Array]]:
    """The unit of the frequencies, and the columns by the words before their units."""
    head, *rows = read_rows(table, REMEDY) or [[]]
    try:
        values = np.array([[float(cell) for cell in row] for row in rows], dtype=np.float64)
        columns = dict(zip((name.partition(" [")[0] for name in head), values.T, strict=True))
    except ValueError as error:
        raise BadParameter(f"{printable(table)} is no table of an MTF", REMEDY) from error
    if "frequency" not in columns or not np.isfinite(values).all():
        raise BadParameter(f"{printable(table)} is no table of an MTF", REMEDY)
    return next((one for one in Unit if f"[{one}]" in head[0]), Unit.CYCLES), columns
