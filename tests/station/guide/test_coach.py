"""The coach: previews while a person corrects a pose, a question that the photographs answer, and the progress."""

import threading
from dataclasses import dataclass, field
from math import inf
from pathlib import Path

import cv2
import numpy as np
import pytest

from procedures.drawings.screws import screws_drawing
from procedures.pattern_psf.plan import FEWEST, goal_of
from procedures.plan import Advice, Ask, Goal, Look, Outline
from procedures.raw import Plane
from procedures.restoration.facts import RestorationFacts
from procedures.restoration.progress import DISC, moved, picture_error, progress, view_of
from procedures.sensor.plan import gain_uncertainty, panel_outline
from procedures.slanted_edge.find import longest_segment
from procedures.slanted_edge.pose import edge_outline
from procedures.tilt.plan import focus_um
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
    upright = Outline(((0.0, 0.0), (0.0, 10.0)), ((-1.0, 0.0), (1.0, 10.0)))
    assert way_words(upright, (100, 100)) == "2 % larger, turned counter-clockwise"


def test_a_panel_an_edge_and_a_scene_are_matched_by_their_outlines():
    lit = np.full((60, 80), 0.02, np.float32)
    lit[10:, :50] = 0.6
    panel = panel_outline(lit)
    assert panel.present[0] == pytest.approx((0.0, 10.0), abs=1.5)
    assert panel.present[2] == pytest.approx((50.0, 59.0), abs=1.5)
    assert panel.growth > 1.3
    straight = np.where(np.arange(200) < 100, 0.1, 0.7)[None].repeat(150, axis=0).astype(np.float32)
    edge = edge_outline(straight, longest_segment(straight))
    assert abs(edge.turn_deg) == pytest.approx(5.0, abs=0.3)
    assert edge.arrow == pytest.approx((0.0, 0.0), abs=1e-6)
    scene = cv2.GaussianBlur(np.random.default_rng(1).random((240, 320)).astype(np.float32), (0, 0), 12)
    first, now = (Plane("Y", scene[20:200, left : left + 240], quantisation=0.0) for left in (40, 16))
    assert moved(first, view_of(first)).off_px < 2.0
    assert moved(now, view_of(first)).arrow[0] == pytest.approx(-24.0, abs=4.0)


def test_progress_screws_and_poses_are_coached():
    assert Goal(4, "MTF", "", inf, inf).say.startswith("MTF: more photographs are needed to state it; 4 ")
    assert Goal(4, "MTF", "", inf, 0.1).say.startswith("MTF: unknown now, ± 0.1 after the next photograph; 4 ")
    # K is a line through 0: two levels of variances known to sqrt(2/N) each
    assert gain_uncertainty([1.0, 1.0, 0.0, 0.0], 200.0) == pytest.approx(0.1)
    assert gain_uncertainty([1.0, 1.0, 1.0, 1.0], 200.0) == pytest.approx(0.1 / 3**0.5)
    assert gain_uncertainty([1.0, 0.5], 200.0) == inf
    both = [picture_error([DISC * 3 * share for share in shares], 0.01, 0.15) for shares in ([1.0], [1.0, 0.5])]
    assert 0.15 > both[0] > both[1] > 0.01
    by_hand = RestorationFacts(blur_by="motions", max_w=4.0, first_noise=0.0066, first_contrast=0.118)
    goal = progress(1, by_hand, lambda which: None)
    assert (goal.left, goal.now, goal.after) == (1, pytest.approx(3.2, abs=0.1), pytest.approx(1.9, abs=0.1))
    # brackets of the simulated bench, whose MTF at the start has 0.245 % of noise: 0.41 um a place
    assert focus_um(0.00245, 33.3) == pytest.approx(0.41, rel=0.2)
    lines = screws_drawing((0.0, 90.0, 180.0, 270.0)).splitlines()
    assert (lines[0].split(), lines[-1].split()) == (["1"], ["3"])
    assert {"4", "2"} <= set(lines[5].split())
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
    words = "MTF50 between photographs: ± 0.0028 now, ± 0.0023 cycles/pixel after the next photograph"
    assert goal.say == f"{words}; 2 photographs to the goal."
    assert Goal(1).say == "The uncertainty is known after the estimate; 1 photograph to the goal."


def test_every_question_is_explained(tmp_path):
    asks = {key: ask for name in PLANS for key, ask in plan_named(name, tmp_path).asks().items()}
    asks = {key: ask for key, ask in asks.items() if not key.startswith(SETTING)}
    assert not asks.keys() - WHY.keys()
    assert not CONSENTS.keys() - WHY.keys()
    assert explain(asks["ruler_mm"], None)[2:] == ["Answer: a number in mm, from 80 to 125.", "Enter accepts 100 mm."]
