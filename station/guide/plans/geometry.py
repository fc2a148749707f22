"""The files of `station geometry`, of a guided session's one plane."""

from __future__ import annotations

from collections.abc import Sequence

from procedures.raw import RawFrame
from station.calibration.geometry_files import geometry_measurement, session_plane
from station.procedure.registry import procedure_named
from station.results.measurement import write_measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead
from station.results.result_files import ResultFolder


def write(folder: ResultFolder, plane: PlaneResult, frames: Sequence[RawFrame], head: RecordHead) -> str:
    """Tables, page and record; of what was refused the record alone."""
    found = geometry_measurement([session_plane(plane, frames)], head)
    if not found.refused:
        folder.write("report.html", procedure_named("geometry").page(found))
    return write_measurement(folder, found)
