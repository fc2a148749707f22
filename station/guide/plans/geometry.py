"""The guided plan of a camera's geometry, with its files."""

from __future__ import annotations

from collections.abc import Sequence

from procedures.geometry.plan import plan as plan
from procedures.plan import Facts, Outcomes
from procedures.raw import RawFrame
from station.calibration.geometry_files import geometry_measurement, session_plane
from station.procedure.registry import procedure_named
from station.results.measurement import write_measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead
from station.results.result_files import ResultFolder
from station.results.terms import Terms


def results(frames: Sequence[RawFrame], outcomes: Outcomes, terms: Terms, facts: Facts) -> list[PlaneResult]:
    """The estimate's numbers."""
    return [
        PlaneResult.of_outcome(name, one, found=one.value, numbers={} if one.value is None else one.value.numbers())
        for name, one in outcomes.items()
    ]


def write(folder: ResultFolder, planes: Sequence[PlaneResult], frames: Sequence[RawFrame], head: RecordHead) -> str:
    """Write the files of `station geometry` for a session; the record alone for a refused result."""
    (plane,) = planes
    measurement = geometry_measurement([session_plane(plane, frames)], head)
    if not measurement.refused:
        folder.write("report.html", procedure_named("geometry").page(measurement))
    return write_measurement(folder, measurement)
