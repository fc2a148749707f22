"""The coach: previews while a person corrects a pose, a question that the photographs answer, and the progress."""

import threading
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from procedures.pattern_psf.plan import FEWEST, goal_of
from procedures.plan import Advice, Ask, Goal, Look, Outline
from station.guide import coach
from station.guide.catalogue import PLANS, plan_named
from station.guide.coach import until_held, way_words, ways
from station.guide.frontend import CONSENTS, FrameEvent
from station.guide.plans.general import SETTING
from station.guide.question_help import WHY, explain
from station.guide.run import Run
from station.guide.scripted import ScriptedOperator
from tests.station.guide import benches

SQUARE = ((10.0, 10.0), (20.0, 10.0), (20.0, 20.0), (10.0, 20.0))
LARGER = ((28.0, 8.0), (42.0, 8.0), (42.0, 22.0), (28.0, 22.0))
OUTLINE = Outline(SQUARE, LARGER)


def test_the_way_of_an_outline_to_its_place():
    assert OUTLINE.arrow == (20.0, 0.0)
    assert OUTLINE.growth == pytest.approx(1.4)
    assert OUTLINE.off_px == pytest.approx((22**2 + 2**2) ** 0.5)
    assert ways(OUTLINE, (100, 200)) == [("→", 0.1)]
    assert way_words(OUTLINE, (100, 200)) == "→ 10 % of the frame, 40 % larger"
    assert Outline((), LARGER).off_px == float("inf")


def test_a_pose_must_be_held_without_interruption():
    times, goods = iter([0.0, 1.0, 2.0, 3.0, 4.0, 6.0]), iter([False, True, False, True, True, True])
    shown = []
    held = until_held(
        lambda: None, lambda frame: Advice(next(goods), ""), lambda frame, advice, left_s: shown.append(left_s),
        lambda advice: advice.good, lambda good: False, lambda: next(times),
    )  # fmt: skip
    assert held
    assert shown == [None, coach.HOLD_S, None, coach.HOLD_S, 2.0, 0.0]


@dataclass
class Watcher(ScriptedOperator):
    """A front end with a live picture, whose operator answers nothing by hand."""

    settled: threading.Event = field(default_factory=threading.Event)
    open: threading.Event = field(default_factory=threading.Event)

    def answer(self, ask: Ask):
        if ask.key != "by_hand":
            return super().answer(ask)
        self.open.set()
        assert self.settled.wait(20.0)
        return True

    def settle(self, fact) -> bool:
        if self.open.is_set():
            self.settled.set()
        return self.open.is_set()


def test_a_held_pose_answers_the_question_and_its_previews_are_not_kept(bench, session, monkeypatch):
    monkeypatch.setattr(coach, "HOLD_S", 0.0)
    looks = []

    def check(frame, facts):
        looks.append(frame.path)
        return Advice(len(looks) > 3, "Turn the chart.", by_hand={"chart_yaw_deg": 1.0}, outline=OUTLINE)

    operator = Watcher()
    assert Run(benches.short_plan(look=Look("trial", check)), bench, session, operator).go().how == "finished"
    assert operator.settled.is_set(), "the pose answers, not a key"
    trials = [shot for shot in session.state.shots if shot.purpose == "trial"]
    assert len(trials) == 2, "one before the correction, one after it"
    assert len(looks) == 5
    assert not any(path.exists() for path in map(Path, looks[1:4])), "previews leave no file"
    holds = [event.hold_s for event in operator.heard if isinstance(event, FrameEvent)]
    assert holds[:4] == [None, None, None, 0.0]


def test_the_progress_of_a_mean_follows_its_weights():
    goal = goal_of([1 / 0.004**2] * 2, 0.002)  # 1/u^2 adds up: four photographs of 0.004 give 0.002
    assert (goal.left, goal.now, goal.after) == (2, pytest.approx(0.004 / 2**0.5), pytest.approx(0.004 / 3**0.5))
    assert goal_of([1.0], 10.0).left == FEWEST - 1, "fewer cannot be tested for agreement"
    words = "MTF50 ± 0.0028 now, ± 0.0023 cycles/pixel after the next photograph; 2 photographs to the goal."
    assert goal.say == words
    assert Goal(1).say == "1 photograph to the goal."


def test_every_question_is_explained(tmp_path):
    asks = {key: ask for name in PLANS for key, ask in plan_named(name, tmp_path).asks().items()}
    asks = {key: ask for key, ask in asks.items() if not key.startswith(SETTING)}
    assert not asks.keys() - WHY.keys()
    assert not CONSENTS.keys() - WHY.keys()
    assert explain(asks["ruler_mm"], None)[2:] == ["Answer: a number in mm, from 80 to 125.", "Enter accepts 100 mm."]
