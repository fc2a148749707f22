"""A camera's geometry, guided: each view is where the projection gains most, brought there by head and hands."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from procedures.facts import facts_as
from procedures.geometry.facts import GeometryFacts
from procedures.geometry.plan import BEFORE, FEWEST, TURN_DEG
from station.bench.opening import simulated_bench
from station.guide.catalogue import plan_named
from station.guide.frontend import Result
from station.guide.run import Run
from station.guide.scripted import Scripted
from station.sessions.session import Session
from tests.end_to_end.test_field_guide import as_left

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    root = tmp_path_factory.mktemp("geometry")
    (root / "incoming").mkdir()
    bench = simulated_bench(root / "incoming", seed=3, virtual_time=True)
    view = bench.simulated.view
    view.camera = replace(view.camera, oversampling=4, lens=replace(view.camera.lens, k1=-0.02))
    with Session.create(root, plan="geometry", camera="C", lens="L", config={}, clock=bench.clock, seed=3) as session:
        session.learn(as_left(bench))
        for name in BEFORE:
            session.begin_step(name)
            session.finish_step(name)
        operator = Scripted({"views": float(FEWEST)})
        end = Run(plan_named("geometry"), bench, session, operator).go()
        (result,) = (event for event in operator.heard if isinstance(event, Result))
        told = SimpleNamespace(end=end, state=session.state, result=result, view=view, minutes=bench.clock.now_s() / 60)
    bench.close()
    return told


def test_every_view_counts_once_in_under_ten_minutes(done):
    assert done.end.how == "finished"
    assert [shot.purpose for shot in done.state.counting()] == [f"view {i} of {FEWEST}" for i in range(1, FEWEST + 1)]
    assert done.minutes < 10


def test_views_are_turned_to_several_sides(done):
    poses = [one.pose for one in facts_as(GeometryFacts, done.state.facts).poses]
    assert len({(round(one.yaw_deg / 35), round(one.pitch_deg / 35)) for one in poses}) >= 3
    assert all(max(abs(one.yaw_deg), abs(one.pitch_deg)) < 35 + TURN_DEG for one in poses)


def test_the_camera_is_the_simulated_one(done):
    record = json.loads((done.result.folder / "result.json").read_text())
    plane = record["planes"]["G1"]
    view = done.view
    true = np.mean([taken.truths[0].projection.principal_px for taken in view.taken[-FEWEST:]])
    focal = plane.get("f") or plane["fx"]
    assert focal["value"] == pytest.approx(true, abs=4 * focal["uncertainty"] + 1e-3 * true)
    assert plane["next_view"]["after_px"] < plane["next_view"]["before_px"]
    assert (done.result.folder / "report.html").is_file()
