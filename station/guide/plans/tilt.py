"""The guided plan of a sensor's tilt, with the estimate that draws the plane from its bracket."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from procedures.facts import facts_as, required
from procedures.field.estimate import FIELD
from procedures.field.measuring import measure_frames
from procedures.pattern_psf.checks import shown
from procedures.plan import Facts, Known, Outcomes, Plan
from procedures.raw import RawFrame
from procedures.tilt import plan as guide
from procedures.tilt.estimate import TiltParameters
from procedures.tilt.facts import DEPTH, TiltFacts
from procedures.tilt.plan import MARK
from procedures.tilt.positions import Positions
from station.calibration.tilt import measure_tilt, tilt_measurement
from station.results.measurement import write_measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead
from station.results.result_files import ResultFolder

RAIL_MM = 0.1
"""Standard uncertainty of the rail's positions."""


def plan() -> Plan:
    """The plan."""
    return guide.plan(estimate)


def estimate(frames: Sequence[RawFrame], facts: Facts, known: Known) -> Outcomes:
    """The sensor's plane, by the plane that it was measured in."""
    told = facts_as(TiltFacts, facts)
    where: dict[str, float] = {}

    def of_one_plane() -> Iterator[RawFrame]:
        for frame in frames:
            if (depth := told.depths.get(frame.sha256[:MARK])) is not None:
                where[frame.path.name] = depth
                plane = shown(frame)
                yield replace(frame, planes={plane.name: plane})

    measured = measure_frames(of_one_plane(), told.chart, FIELD)
    name = next(iter(measured.planes), "Y")
    parameters = TiltParameters(
        required(told.pixel_pitch_um, "the distance of the sensor's pixels", "answer the step `distance`"),
        Positions.CHART,
        told.focal_length_mm,
        position_uncertainty_mm=RAIL_MM,
        screws=told.screws,
    )
    return {name: measure_tilt(measured, name, where, parameters)}


def write(folder: ResultFolder, planes: Sequence[PlaneResult], frames: Sequence[RawFrame], head: RecordHead) -> str:
    """The files of `station tilt`, of a session's one plane."""
    from station.reports.tilt_page import tilt_page  # it draws: that import is slow

    (plane,) = planes
    outcome = plane.outcome(plane.found)
    parameters = {name: one for name, one in head.parameters.items() if not name.startswith(DEPTH)}
    folder.write("report.html", tilt_page(plane.name, len(frames), outcome).encode())
    return write_measurement(folder, tilt_measurement(replace(head, parameters=parameters), plane.name, outcome))
