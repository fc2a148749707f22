"""A lens or a print given wrongly on the simulated bench: it is named before the rail is driven anywhere by it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from station.bench.opening import simulated_bench
from station.guide.catalogue import plan_named
from station.guide.frontend import Trouble
from station.guide.run import Run
from station.guide.scripted import Scripted
from station.sessions.session import Session

pytestmark = pytest.mark.slow
CASES = {
    "lens and sensor": (
        {"focal_length_mm": 50.0, "which_focal_length_mm": "50 mm", "pixel_pitch_um": 4.0},
        "a focal length of",
        "distance",
    ),
    "sensor": ({"pixel_pitch_um": 5.94 * 1.2}, "pixel pitch of", "distance"),
    "ruler": ({"ruler_mm": 80.0}, "a ruler that measures", "distance"),
    "chart": ({"chart_seed": 7.0}, "other cells than those of its number 7; they are those of 1", "mount"),
}


@pytest.mark.parametrize(("plan", "case"), [*(("pattern", case) for case in CASES), ("field", "ruler")])
def test_it_is_named_within_two_steps_and_within_two_photographs(plan, case, tmp_path):
    answers, words, step = CASES[case]
    incoming = tmp_path / "incoming"
    incoming.mkdir()
    bench = simulated_bench(incoming, seed=3, virtual_time=True)
    view = bench.simulated.view
    view.camera = replace(view.camera, oversampling=4)  # finer than any of these numbers is wrong
    session = Session.create(tmp_path, plan=plan, camera="C", lens="L", config={}, clock=bench.clock, seed=3)
    session.learn({key: value for key, value in answers.items() if key == "chart_seed"})
    operator = Scripted({**answers, "contradiction": "stop"})
    ended = Run(plan_named(plan), bench, session, operator).go()
    state = session.state
    session.close()
    bench.close()
    assert ended.how == "stopped"
    assert state.step == step
    reason = [event.reason for event in operator.heard if isinstance(event, Trouble)][-1]
    assert words in reason
    assert sum(shot.step == "distance" for shot in state.shots) <= 2
