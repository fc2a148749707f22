"""Nothing moves without approval: what is asked, when, and the meaning of "no"."""

import pytest

from procedures.plan import Advice, Go, Look
from simulators.bench.bench import FaultEvent
from station.guide.frontend import MOVE, FrameEvent
from station.guide.run import Run
from station.guide.scripted import ScriptedOperator
from station.sessions.session import Session

from . import benches


class Watchful(ScriptedOperator):
    """Notes every question before a move, and what had moved when it was asked."""

    def __init__(self, bench, answers=None):
        super().__init__(answers or {})
        self.bench, self.questions, self.moved = bench, [], []
        for name in ("stage", "head"):
            self._watch(bench.devices[name])

    def _watch(self, stage):
        for verb in ("home", "move_to"):
            act = getattr(stage, verb)

            def noted(*args, act=act, verb=verb, **target):
                self.moved.append((verb, len(self.questions)))
                return act(*args, **target)

            setattr(stage, verb, noted)

    def answer(self, ask):
        if ask.key == MOVE:
            self.questions.append(ask.question)
        return super().answer(ask)


@pytest.mark.slow
def test_each_request_that_moves_asks_once_with_axis_start_and_target(bench, session):
    operator = Watchful(bench)
    assert Run(benches.short_plan(), bench, session, operator).go().how == "finished"
    home, go, scan = operator.questions
    assert home.startswith("Homing")
    assert "z within 0 to 1500 mm" in home
    assert "pan" in home
    assert go == "Moving z from 1499.0 to 700.0 mm."  # 1 mm before the switch
    assert scan == "Moving z from 700.0 to 600.0 mm, then to 3 places between 600.0 mm and 640.0 mm."
    # both stages home after the first question, the rail goes after the second; after the third, places and the best
    assert operator.moved == [("home", 1)] * 2 + [("move_to", 2)] + [("move_to", 3)] * 4


def test_without_consent_nothing_moves(bench, session):
    operator = Watchful(bench, {MOVE: False})
    Run(benches.short_plan(), bench, session, operator).go()
    assert operator.questions
    assert operator.moved == []


@pytest.mark.slow
def test_corrections_of_one_look_are_approved_once_and_not_requested_from_the_operator(bench, session):
    def nearer(frame, facts):
        off = 900.0 - facts["at_z_mm"]
        return Advice(abs(off) < 1, f"Move the camera by {off:.0f} mm.", moves={"z_mm": off / 2 if off > 50 else off})

    operator = Watchful(bench)
    Run(benches.short_plan(look=Look("trial", nearer)), bench, session, operator).go()
    (question,) = [one for one in operator.questions if "Further moves of this step follow" in one]
    assert "z from 700.0 to 800.0 mm" in question
    says = [event.advice.say for event in operator.heard if isinstance(event, FrameEvent) and not event.advice.good]
    assert len(says) >= 3  # 200, 100, 50 mm
    assert all(say.startswith("The bench corrects this: z to ") for say in says)


@pytest.mark.slow
def test_after_manual_work_the_next_correction_needs_a_new_approval(bench, session):
    advices = [
        Advice(False, "nearer", moves={"z_mm": 10.0}),
        Advice(False, "Turn the chart.", by_hand={"chart_yaw_deg": 1.0}),
        Advice(False, "nearer", moves={"z_mm": 10.0}),
        Advice(True, "good"),
    ]
    operator = Watchful(bench)
    turns = iter(advices)
    Run(benches.short_plan(look=Look("trial", lambda frame, facts: next(turns))), bench, session, operator).go()
    assert sum("Further moves of this step follow" in question for question in operator.questions) == 2


@pytest.mark.slow
def test_the_current_position_needs_no_approval(bench, session):
    there = Go(lambda facts: {"z_mm": facts["at_z_mm"]}, lambda facts: "going nowhere")
    operator = Watchful(bench)
    Run(benches.short_plan(go=there), bench, session, operator).go()
    home, scan = operator.questions
    assert home.startswith("Homing")
    assert "3 places" in scan


def test_a_resumed_session_asks_before_going_back(bench, session):
    def stop(event):
        if isinstance(event, FrameEvent) and len(session.state.shots) == 5:
            run.ask_to_stop()

    run = Run(benches.short_plan(), bench, session, ScriptedOperator(listen=stop))
    assert run.go().how == "stopped"
    session.close()
    with Session.open(session.folder, bench.clock) as again:
        operator = Watchful(bench)
        assert Run(benches.short_plan(), bench, again, operator).go().how == "finished"
    (question,) = operator.questions
    assert question.startswith("Homing")
    assert "then " in question
    assert "z to 620.0 mm" in question
    assert all(count == 1 for _, count in operator.moved)


@pytest.mark.slow
def test_a_stage_that_lost_its_position_does_not_home_again_without_approval(tmp_path):
    with (
        benches.quick_bench(tmp_path, fault_events=[FaultEvent(19.0, "alarm", 1)]) as bench,
        benches.new_session(tmp_path, bench) as session,
    ):
        operator = Watchful(bench)
        assert Run(benches.short_plan(), bench, session, operator).go().how == "finished"
    again = [i for i, question in enumerate(operator.questions) if question.endswith("back to the last position.")]
    first, *later = [count for verb, count in operator.moved if verb == "home"]
    assert first == 1
    assert again == [1]
    # the alarm came while homing; after the second question the failed stage homes, then both
    assert later in ([2] * 3, [1, 2, 2, 2])
