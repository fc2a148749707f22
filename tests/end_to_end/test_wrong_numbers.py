"""A lens or a print given wrongly on the simulated bench: it is named before the rail moves by it."""

import pickle
from dataclasses import replace

import pytest

from simulators.camera.camera import SimulatedCamera
from station.bench.opening import simulated_bench
from station.guide.catalogue import plan_named
from station.guide.frontend import ProblemEvent, StepEnded
from station.guide.run import Run
from station.guide.scripted import ScriptedOperator
from station.sessions.session import Session
from tests.end_to_end.test_camera_guide import as_left

pytestmark = pytest.mark.slow
CASES = {
    "lens and sensor": (
        {"focal_length_mm": 50.0, "which_focal_length_mm": "50 mm", "pixel_pitch_um": 4.0},
        "a focal length of",
        "distance",
    ),
    "sensor": ({"pixel_pitch_um": 5.94 * 1.2}, "pixel pitch of", "distance"),
    "ruler": ({"ruler_mm": 80.0}, "a ruler that measures", "distance"),
    "chart": ({"chart_seed": 7.0}, "cells of number 7, but those of number 1", "mount"),
}


@pytest.fixture(scope="module", autouse=True)
def drawn_once():
    """These benches begin alike: what one camera sees of a scene is what the next sees, and is drawn once."""
    drawn, draw = {}, SimulatedCamera.light

    def light(camera, scene):
        key = pickle.dumps((camera, scene))
        if key not in drawn:
            drawn[key] = draw(camera, scene)
        return drawn[key]

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(SimulatedCamera, "light", light)
        yield


@pytest.mark.parametrize(("plan", "case"), [*(("pattern", case) for case in CASES), ("field", "ruler")])
def test_it_is_named_within_two_steps_and_within_two_photographs(plan, case, tmp_path):
    answers, words, step = CASES[case]
    incoming = tmp_path / "incoming"
    incoming.mkdir()
    bench = simulated_bench(incoming, seed=3, virtual_time=True)
    view = bench.simulated.view
    view.camera = replace(view.camera, oversampling=4)  # error below that of any of these numbers
    session = Session.create(tmp_path, plan=plan, camera="C", lens="L", config={}, clock=bench.clock, seed=3)
    session.learn({key: value for key, value in answers.items() if key == "chart_seed"})
    operator = ScriptedOperator({**answers, "contradiction": "stop"})
    ended = Run(plan_named(plan), bench, session, operator).go()
    state = session.state
    session.close()
    bench.close()
    assert ended.how == "stopped"
    assert state.step == step
    reason = [event.reason for event in operator.heard if isinstance(event, ProblemEvent)][-1]
    assert words in reason
    assert sum(shot.step == "distance" for shot in state.shots) <= 2


BEFORE_FOCUS = ("print", "mount", "distance", "square")


@pytest.mark.parametrize(("plan", "factor"), [("pattern", 0.5), ("pattern", 1.0), ("field", 2.0)])
def test_an_f_number_that_the_camera_does_not_note_is_compared_with_the_far_tail(plan, factor, tmp_path):
    incoming = tmp_path / "incoming"
    incoming.mkdir()
    bench = simulated_bench(incoming, seed=3, virtual_time=True)
    bench.surroundings.stand_before(plan_named(plan).subject)  # puts the subject's camera into the view
    view = bench.simulated.view
    lens = replace(view.camera.lens, f_number=8.0, noted=False)
    view.camera = replace(view.camera, lens=lens, oversampling=4)
    session = Session.create(tmp_path, plan=plan, camera="C", lens="L", config={}, clock=bench.clock, seed=3)
    session.learn({key: value for key, value in as_left(bench).items() if key != "f_number"})
    for name in BEFORE_FOCUS:
        session.begin_step(name)
        session.finish_step(name)
    typed = {"typed_f_number": factor * lens.f_number, "focus_by": "skip", "contradiction": "stop"}
    operator = ScriptedOperator(typed)
    run = Run(plan_named(plan), bench, session, operator)

    def listen(event):
        if isinstance(event, StepEnded):
            run.ask_to_stop()

    operator.listen = listen
    run.go()
    state = session.state
    session.close()
    bench.close()
    reasons = [event.reason for event in operator.heard if isinstance(event, ProblemEvent)]
    assert [f"f/{factor * 8:g}" in reason and "given" in reason for reason in reasons] == (
        [] if factor == 1 else [True]
    )
    assert ("focus" in state.done) == (factor == 1)
    assert sum(shot.step == "focus" for shot in state.shots) == 1
