"""The guided plan of a camera's geometry, with its files."""

from collections.abc import Sequence

from procedures.geometry.plan import plan as plan
from procedures.plan import Facts, Outcomes
from procedures.raw import RawFrame
from station.calibration.geometry_files import geometry_measurement, session_plane
from station.results.measurement import Measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead
from station.results.terms import Terms


def results(frames: Sequence[RawFrame], outcomes: Outcomes, terms: Terms, facts: Facts) -> list[PlaneResult]:
    """The estimate's numbers."""
    return [
        PlaneResult.of_outcome(name, one, estimate=one.value, numbers={} if one.value is None else one.value.numbers())
        for name, one in outcomes.items()
    ]


def measurement(planes: Sequence[PlaneResult], frames: Sequence[RawFrame], head: RecordHead) -> Measurement:
    """That of `station geometry`."""
    (plane,) = planes
    return geometry_measurement([session_plane(plane, frames)], head)
