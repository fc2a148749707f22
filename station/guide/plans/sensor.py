"""The guided plan of a sensor, with the estimate that groups its frames by light level."""

from collections.abc import Sequence

from procedures.outcome import BadInput, Outcome, Verdict
from procedures.plan import Facts, Known, Outcomes, Plan, facts_as
from procedures.raw import RawFrame
from procedures.sensor import plan as guide
from procedures.sensor.plan import SensorFacts, mark_of
from station.calibration.sensor import SensorFiles, SensorPlane, measure_sensor
from station.calibration.sensor_files import sensor_measurement
from station.calibration.sensor_folder import DARK, LIGHT, Shots
from station.results.measurement import Measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead
from station.results.terms import Terms


def plan() -> Plan:
    """The plan."""
    return guide.plan(estimate)


def estimate(frames: Sequence[RawFrame], facts: Facts, known: Known) -> Outcomes:
    """The whole sensor for every plane, with the plane's verdict; a refusal where the frames give none."""
    lit = facts_as(SensorFacts, facts).lit
    groups: dict[float, list[int]] = {}
    exposures, names = [], {}
    for i, frame in enumerate(frames):
        exposures.append(frame.exposure.exposure_s or 1.0)
        names[frame.path] = i
        if (light := lit.get(mark_of(frame.sha256))) is not None:
            groups.setdefault(light, []).append(i)
    paths = list(names)
    shots = [
        Shots(LIGHT if light else DARK, exposures[taken[0]], None, light or None, tuple(paths[i] for i in taken))
        for light, taken in sorted(groups.items())
    ]
    try:
        whole = measure_sensor(shots, None, read=lambda path: frames[names[path]])
    except BadInput as refusal:
        planes = frames[0].planes if frames else ()
        return {name: Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy) for name in planes}
    return {plane.name: plane.outcome.of_value(whole) for plane in whole.planes}


def results(frames: Sequence[RawFrame], outcomes: Outcomes, terms: Terms, facts: Facts) -> list[PlaneResult]:
    """Every plane's numbers; `estimate` of each is the whole sensor."""
    return [_result(name, outcome) for name, outcome in outcomes.items()]


def _result(name: str, outcome: Outcome[SensorFiles]) -> PlaneResult:
    whole = outcome.value
    sensor = None if whole is None else next(plane for plane in whole.planes if plane.name == name).outcome.value
    numbers = {} if sensor is None else dict(sensor.numbers)
    return PlaneResult.of_outcome(name, outcome, estimate=whole, numbers=numbers)


def measurement(planes: Sequence[PlaneResult], frames: Sequence[RawFrame], head: RecordHead) -> Measurement:
    """That of `station sensor`."""
    whole: SensorFiles | None = next((plane.estimate for plane in planes if plane.estimate is not None), None)
    refused = [SensorPlane(plane.name, plane.outcome(None), (), 1.0, None) for plane in planes]
    return sensor_measurement(whole or SensorFiles((), None, None, refused), head)
