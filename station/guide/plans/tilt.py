"""The guided plan of a sensor's tilt, with the estimate from its focus bracket."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from procedures.field.estimate import FIELD
from procedures.field.measuring import measure_frames
from procedures.pattern_psf.checks import shown
from procedures.plan import Facts, Known, Outcomes, Plan, facts_as, required
from procedures.raw import RawFrame
from procedures.tilt import plan as guide
from procedures.tilt.estimate import TiltParameters
from procedures.tilt.plan import DEPTH, MARK, TiltFacts
from procedures.tilt.plane import Positions
from station.calibration.tilt import measure_tilt, tilt_measurement
from station.guide.plans.geometry import results as results
from station.results.measurement import Measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead

RAIL_MM = 0.1


def plan() -> Plan:
    """The plan."""
    return guide.plan(estimate)


def estimate(frames: Sequence[RawFrame], facts: Facts, known: Known) -> Outcomes:
    """The sensor's tilt, under the name of the colour plane in which it was measured."""
    known_facts = facts_as(TiltFacts, facts)
    depths: dict[str, float] = {}

    def frames_of_one_plane() -> Iterator[RawFrame]:
        for frame in frames:
            if (depth := known_facts.depths.get(frame.sha256[:MARK])) is not None:
                depths[frame.path.name] = depth
                plane = shown(frame)
                yield replace(frame, planes={plane.name: plane})

    measured = measure_frames(frames_of_one_plane(), known_facts.chart, FIELD)
    name = next(iter(measured.planes), "Y")
    parameters = TiltParameters(
        required(known_facts.pixel_pitch_um, "the sensor's pixel pitch", "answer the step `distance`"),
        Positions.CHART,
        known_facts.focal_length_mm,
        position_uncertainty_mm=RAIL_MM,
        screws=known_facts.screws,
    )
    return {name: measure_tilt(measured, name, depths, parameters)}


def measurement(planes: Sequence[PlaneResult], frames: Sequence[RawFrame], head: RecordHead) -> Measurement:
    """That of `station tilt`."""
    (plane,) = planes
    parameters = {name: value for name, value in head.parameters.items() if not name.startswith(DEPTH)}
    return tilt_measurement(replace(head, parameters=parameters), plane.name, plane.outcome(plane.estimate))
