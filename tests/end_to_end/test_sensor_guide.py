"""A sensor, guided: the panel makes the ladder, and the numbers are the simulated sensor's."""

import json
from dataclasses import replace
from types import SimpleNamespace

import pytest

from procedures.sensor.plan import ladder, plan
from station.bench.opening import simulated_bench
from station.guide.frontend import Result
from station.guide.plans.sensor import estimate
from station.guide.recompute import recompute
from station.guide.run import Run
from station.guide.scripted import ScriptedOperator
from station.sessions.session import Session

pytestmark = pytest.mark.slow

LEVELS, PICTURES = 16, 3


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    root = tmp_path_factory.mktemp("sensor")
    (root / "incoming").mkdir()
    bench = simulated_bench(root / "incoming", seed=3, virtual_time=True)
    view = bench.simulated.view
    sensor = replace(view.camera.sensor, cfa=None)  # what is done to each of a mosaic's planes is done here to one
    view.camera = replace(view.camera, sensor=sensor)
    with Session.create(root, plan="sensor", camera="C", lens="L", config={}, clock=bench.clock, seed=3) as session:
        operator = ScriptedOperator()
        end = Run(plan(estimate, LEVELS, PICTURES), bench, session, operator).go()
        (result,) = (event for event in operator.heard if isinstance(event, Result))
        collected = SimpleNamespace(
            end=end, state=session.state, folder=session.folder, result=result, sensor=sensor,
            minutes=bench.clock.now_s() / 60,
        )  # fmt: skip
    bench.close()
    return collected


def test_gain_and_noise_are_the_sensor_s_from_pictures_taken_once_each(done):
    assert done.end.how == "finished"
    taken = [shot.purpose for shot in done.state.counting()]
    pairs = [f"level {light:.3f}" for light in ladder(LEVELS) for _ in range(2)]
    assert taken == ["dark"] * PICTURES + pairs + ["flat"] * PICTURES
    assert done.minutes < 10
    collected = json.loads((done.result.folder / "result.json").read_text())["planes"]["Y"]
    assert collected["verdict"] != "refused", collected["reason"]
    truths = {"system_gain": 1 / done.sensor.gain_e_per_dn, "temporal_dark_noise": done.sensor.read_noise_e}
    for name, true in truths.items():
        one = collected[name]
        assert one["value"] == pytest.approx(true, abs=4 * one["uncertainty"] + 0.003 * true), name
    names = {path.name for path in done.result.folder.iterdir()}
    assert {"emva1288.xml", "report.html", "transfer_Y.csv", "numbers.csv"} <= names
    (again,) = recompute(done.folder)
    assert again.identical, again
