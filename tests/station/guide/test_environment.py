"""Readings of probes in the session, the record and the report; drift over a session."""

from dataclasses import replace
from types import SimpleNamespace

import jsonschema
import numpy as np
import pytest

from drivers.errors import NoReading
from drivers.interfaces import Condition, Identity, ProbeReading
from procedures import estimate_psf, read_frame
from procedures.pattern_psf.combine import combine
from simulators.bench.body import Opening
from simulators.bench.view import View, bench_camera
from simulators.camera.sensor import Sensor
from simulators.world.world import World, WorldParameters
from station.guide.active_devices import ActiveDevices
from station.guide.session_report import _environment, drift_lines
from station.procedure.schema import procedure_named, schema_of
from station.reports.report import environment_lines
from station.results.record_head import ENVIRONMENT, environment_of
from station.sessions.state import SessionShot, SessionState

from ..sessions.short_plan import CHART, PARAMETERS
from . import benches


class FakeProbe:
    """A probe with given readings; without any it cannot measure."""

    address = "fake"

    def __init__(self, *readings):
        self.readings = list(readings)

    def connect(self):
        return Identity("probe", "1", "", self.address)

    def condition(self):
        return Condition("ready")

    def read(self):
        if not self.readings:
            raise NoReading("the probe is too cold", "warm it")
        return self.readings.pop(0)

    def emergency_stop(self): ...

    def close(self): ...


def climate(temperature, humidity=40.0):
    return {"temperature": ProbeReading(temperature, "°C", 0.2), "humidity": ProbeReading(humidity, "%")}


def state_of(*snapshots, times=None):
    """A session with a counting shot for each of these states, a minute apart unless times are given."""
    times = [60.0 * n for n in range(len(snapshots))] if times is None else times
    shots = tuple(
        SessionShot(n, f"{n}.dng", "", 1, "shot", "shots", True, exposure={"requested_s": at}, snapshot=snapshot)
        for n, (snapshot, at) in enumerate(zip(snapshots, times, strict=True))
    )
    return SessionState("pattern", "C", "L", "2026-01-01T00:00:00+00:00", 1, shots=shots)


def test_a_probe_is_read_at_every_photograph(tmp_path):
    with benches.quick_bench(tmp_path) as bench:
        bench.devices["room"] = FakeProbe(climate(21.25), climate(21.75, 45.0))
        rig = ActiveDevices(bench)
        records = [rig.snapshot().record() for _ in range(3)]
    assert records[0][ENVIRONMENT] == {
        "room": {
            "temperature": {"value": 21.25, "unit": "°C", "uncertainty": 0.2},
            "humidity": {"value": 40.0, "unit": "%", "uncertainty": None},
        }
    }
    assert ENVIRONMENT not in records[2]
    assert records[2]["silent"]["room"] == "the probe is too cold"
    entry = environment_of(records)
    assert entry["room"]["temperature"] == {
        "value": 21.5, "unit": "°C", "uncertainty": 0.2, "min": 21.25, "max": 21.75, "n": 2,
    }  # fmt: skip
    assert entry == _environment(state_of(*records))
    schema = schema_of(procedure_named("edge"))
    jsonschema.validate(entry, {**schema["properties"]["environment"], "$defs": schema["$defs"]})
    lines = {line.name: line.words for line in environment_lines(entry)}
    assert lines == {
        "temperature (room)": "21.25 to 21.75 °C, standard uncertainty 0.20 °C",
        "humidity (room)": "40.00 to 45.00 %",
    }


def test_without_a_probe_a_record_has_no_environment():
    assert environment_of([{"axes": {"z_mm": 1.0}}]) is None


def combined(frames):
    return combine([estimate_psf(frame.planes["G1"], CHART, PARAMETERS) for frame in frames])


@pytest.mark.slow
def test_a_rail_that_expands_is_seen_as_the_charts_image_becoming_smaller(tmp_path):
    room = WorldParameters(expansion_per_c=1e-3)  # fifty times an aluminium rail
    world = World(room)
    view = View(world, np.random.default_rng(1), replace(bench_camera(), sensor=Sensor(rows=320, columns=400)))
    times = [700.0 * n for n in range(6)]
    frames, snapshots = [], []
    for n, time_s in enumerate(times):
        path = tmp_path / f"{n}.dng"
        path.write_bytes(view.develop(Opening(time_s, 0.02, n)))
        frames.append(read_frame(path))
        reading = {"value": world.temperature_c(time_s), "unit": "°C", "uncertainty": 0.1}
        snapshots.append({"axes": {"z_mm": 750.0}, ENVIRONMENT: {"room": {"temperature": reading}}})
    state, outcome = state_of(*snapshots, times=times), combined(frames)
    plane = SimpleNamespace(estimate=outcome.value, pitch=2)
    lines = {line.name: line for line in drift_lines(state, {"G1": plane})}
    assert list(lines) == [
        "position, to the right", "position, down", "width of the chart's image", "focus, as MTF50",
    ]  # fmt: skip
    value, _, u, unit = lines["width of the chart's image"].per_kelvin.replace("−", "-").split()
    width = 2 * np.mean([one.pixels_per_pattern for one in outcome.value.shots])
    truth = -width * room.expansion_per_c * world.axes["z_mm"].position(0.0) / world.distance_mm(0.0)
    assert unit == "px/K"
    assert abs(float(value) - truth) < 3 * float(u)
    assert float(u) < 0.1 * abs(truth)
    right, _, u, unit = lines["position, to the right"].per_kelvin.replace("−", "-").split()
    assert (abs(float(right)) < 3 * float(u), unit) == (True, "px/K")
    assert lines["position, down"].per_hour.endswith("px/h")


def shots_of(places, **more):
    """Estimates of one plane whose charts are at these places (x, y)."""
    found = [
        SimpleNamespace(
            registration=SimpleNamespace(to_sensor=lambda cells, place=place: np.array([place], float)),
            pixels_per_pattern=100.0, centre_covariance=np.eye(2) * 1e-6, quality=SimpleNamespace(numbers={}),
        )
        for place in places
    ]  # fmt: skip
    return SimpleNamespace(shots=tuple(found), places=tuple(range(len(found))), **more)


@pytest.fixture
def of_chart(monkeypatch):
    monkeypatch.setattr("station.guide.session_report.CombinedPsf", SimpleNamespace)
    return lambda estimate: {"Y": SimpleNamespace(estimate=estimate, pitch=1)}


def test_slopes_are_of_photographs_from_one_place_over_changing_temperature(of_chart):
    places = [(n, 5.0) for n in range(5)] + [(900.0, 900.0)]
    snapshots = [{"axes": {"z_mm": 1.0}}] * 5 + [{"axes": {"z_mm": 2.0}}]
    lines = {line.name: line for line in drift_lines(state_of(*snapshots), of_chart(shots_of(places)))}
    assert lines["position, to the right"].per_hour.startswith("60.000 ±")  # one pixel a minute
    assert lines["position, to the right"].per_kelvin == "—"
    estimate, reading = of_chart(shots_of([(n, 0.0) for n in range(5)])), {"value": 21.0, "unit": "°C"}
    steady = [{ENVIRONMENT: {"room": {"temperature": {**reading, "value": 21.0 + 0.03 * n}}}} for n in range(5)]
    assert drift_lines(state_of(*steady, times=[1.0, 2.0, 3.0, 1.0, 2.0]), estimate) == []
