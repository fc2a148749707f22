"""Turns of the chart in the guided geometry: in steps robust to distortion, by hand or by the bench."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from procedures.geometry import plan as geometry_plan
from procedures.geometry.facts import GeometryFacts, ViewPose, as_pose, place_of, pose_facts
from procedures.geometry.next_view import NextView
from procedures.geometry.plan import STEP_DEG, turn_chart
from procedures.outcome import BadParameter, Outcome, Refused, Verdict
from procedures.pattern_psf.pose import ChartPose
from procedures.plan import Advice, Reading, facts_as

READINGS = tuple(Reading(name, value, "°", -7.0, 7.0) for name, value in (("off", 0.0), ("yaw", 40.0), ("pitch", 0.0)))
WANTED = NextView((0.5, 0.5), -35.0, 0.0, 1000.0, 0.4, 0.3)


@pytest.mark.parametrize(("present", "turn"), [(6.0, -STEP_DEG), (-24.0, -11.0), (35.0, -70.0)])
def test_a_nearly_frontal_chart_is_turned_in_two_steps(present, turn):
    advice = turn_chart(ChartPose((0.0, 0.0, 1000.0), present, 0.0, 0.0), WANTED, READINGS, ())
    assert advice.by_hand["chart_yaw_deg"] == turn
    assert advice.moves == advice.by_hand  # for a bench with these axes
    assert f"by {abs(turn):.0f}°, its {'right' if turn > 0 else 'left'} edge nearer" in advice.say


WHITE, CLIPPED = Reading("white", 60.0, "%"), Reading("clipped", 0.0, "%")
WRONG = {"yaw_deg": -27.9, "pitch_deg": 7.1}


@pytest.fixture
def seen(monkeypatch):
    """What is seen of a chart that hangs in the wanted pose, to be changed; the geometry behind it is not at work."""
    seen = {
        "changed": "", "sighting": SimpleNamespace(H_sensor_pattern=np.eye(3)), "off": 0.049, "white": WHITE,
        "clipped": CLIPPED, "pose": ChartPose((1.0, 2.0, 1000.0), WANTED.yaw_deg, WANTED.pitch_deg, 3.0),
    }  # fmt: skip
    plane = SimpleNamespace(samples=np.zeros((20, 30)), pitch=2)
    for name, answer in {
        "shown": lambda frame: plane, "changed_settings": lambda exposure, known: seen["changed"],
        "seen_chart": lambda plane, known: seen["sighting"], "wanted_pose": lambda number, known: WANTED,
        "chart_pose": lambda H, shape, optics: seen["pose"], "off_place": lambda *of: seen["off"],
        "wanted_outline": lambda *of: (),
        "light_readings": lambda *of: (seen["white"], seen["clipped"]), "marks_of": lambda sighting: ((1.0, 2.0),),
        "correction": lambda *of: {"pan_deg": 2.0}, "to_place": lambda at, facts: {"pan_deg": 5.0} if facts else {},
    }.items():  # fmt: skip
        monkeypatch.setattr(geometry_plan, name, answer)
    monkeypatch.setattr(GeometryFacts, "optics", lambda self, pitch: None)
    return seen


def view_checked(facts=None):
    return geometry_plan.check_view(4, SimpleNamespace(exposure=None), facts or {})


def test_a_view_in_its_pose_counts_and_its_pose_is_kept(seen):
    advice = view_checked()
    assert (advice.good, advice.say, advice.marks) == (True, "View 4 counts.", ((1.0, 2.0),))
    assert facts_as(GeometryFacts, advice.facts).poses == (ViewPose(4, seen["pose"]),)
    assert [reading.name for reading in advice.readings] == [
        "off its place", "yaw off", "pitch off", "white", "clipped",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("found", "says", "moves"),
    [
        ({"changed": "the ISO is 200"}, "This view does not count: the ISO is 200", {}),
        ({"sighting": Advice(False, "no chart", moves={"z_mm": 1.0})}, "no chart", {}),
        ({"off": 0.051}, "The chart is off its place: it must appear in", {"pan_deg": 2.0}),
        ({"white": Reading("white", 14.9, "%")}, "The chart is too dark in this pose", {}),
        ({"clipped": Reading("clipped", 5.0, "%")}, "White is clipped in this pose", {}),
        ({"yaw_deg": -27.9}, "Turn the chart about its upright axis by 7°, its left edge nearer", None),
        ({"yaw_deg": -42.1}, "Turn the chart about its upright axis by 7°, its right edge nearer", None),
        ({"pitch_deg": 7.1}, "Turn the chart about its level axis by 7°, its lower edge nearer", None),
        ({"pitch_deg": -7.1}, "Turn the chart about its level axis by 7°, its upper edge nearer", None),
        (WRONG, "its left edge nearer; then about its level axis by 7°, its lower", None),
        ({"off": 0.3, "pitch_deg": 7.1}, "its lower edge nearer", None),  # turned first: a turn moves it
    ],
)
def test_a_view_that_does_not_count_says_what_to_do(seen, found, says, moves):
    turns = {name: found.pop(name) for name in list(found) if name in ("yaw_deg", "pitch_deg")} if moves is None else {}
    seen |= found
    seen["pose"] = replace(seen["pose"], **turns)
    advice = view_checked()
    assert not advice.good
    assert says in advice.say
    assert advice.facts == {}
    if moves is not None:
        assert advice.moves == moves
        assert advice.by_hand == {}


@pytest.mark.parametrize("turns", [{"yaw_deg": -28.1}, {"yaw_deg": -41.9}, {"pitch_deg": 6.9}, {"pitch_deg": -6.9}])
def test_a_view_a_little_off_its_pose_counts(seen, turns):
    seen["pose"] = replace(seen["pose"], **turns)
    assert view_checked().good


def test_the_tour_has_as_many_stops_as_were_chosen(seen):
    stops = geometry_plan.stops({"views": 8.0})
    assert [stop.name for stop in stops] == [f"view {i} of 8" for i in range(1, 9)]
    assert len(geometry_plan.stops({})) == geometry_plan.USUAL
    start = geometry_plan.plan().step("start")
    assert [start.value(facts) for facts in ({"views": 8.0}, {})] == ["8 views", ""]
    assert geometry_plan.views_taken({}) == ""
    poses = pose_facts(ViewPose(1, seen["pose"])) | pose_facts(ViewPose(3, seen["pose"]))
    assert geometry_plan.views_taken(poses) == "2 views"
    assert len(facts_as(GeometryFacts, poses).before(3)) == 1


def test_the_head_brings_the_chart_to_its_place_or_the_operator_does(seen):
    assert geometry_plan.say_view(1, {"head": 1.0}).startswith("moving until the chart appears in the middle")
    words = geometry_plan.say_view(1, {})
    assert words.startswith("Turn the camera, and the chart, until it appears in the middle of the frame, 1000 mm away")


def test_a_pose_is_a_rotation_and_the_place_of_the_chart():
    turned = as_pose(ChartPose((1.0, 2.0, 3.0), 90.0, 0.0, 0.0))
    np.testing.assert_allclose(turned.R @ [1, 0, 0], [0, 0, -1], atol=1e-12)  # yaw: its right edge nearer
    np.testing.assert_allclose(as_pose(ChartPose((0, 0, 1.0), 0.0, 0.0, 90.0)).R @ [1, 0, 0], [0, 1, 0], atol=1e-12)
    np.testing.assert_array_equal(turned.t, [1, 2, 3])


def test_the_camera_of_the_data_sheet_has_its_centre_in_the_middle():
    camera = geometry_plan.nominal_camera((20, 30), 50.0)
    np.testing.assert_allclose(camera.project(np.array([[0.0, 0, 1], [0.1, 0.2, 1]])), [[14.5, 9.5], [19.5, 19.5]])


def test_views_are_planned_for_the_place_that_matters_most():
    poses = tuple(
        ChartPose((0.0, 0.0, 1000.0), yaw, pitch, 0.0) for yaw, pitch in ((0.0, 0.0), (25.0, 0.0), (0.0, -25.0))
    )
    lens = (poses, (600, 900), 1000.0, 1000.0, 300 / 320, (0.2, 0.25))
    corner = geometry_plan._planned(*lens, (0.9, 0.1))
    frame = geometry_plan._planned(*lens)
    assert corner.after < corner.before
    assert corner.before > frame.before  # a corner is known less than the mean of the frame
    assert facts_as(GeometryFacts, {"aim": "90,10"}).aimed_at == (0.9, 0.1)
    assert facts_as(GeometryFacts, {}).aimed_at is None
    with pytest.raises(BadParameter, match="two shares in per cent"):
        place_of("900,600")


def test_refused_views_are_named_with_their_reasons(monkeypatch):
    def view(plane, chart, name):
        if name == "a.dng":
            raise Refused("no chart", "photograph one")
        return Outcome("view", Verdict.PASS) if name == "b.dng" else Outcome(None, Verdict.REFUSED, "dark", "light")

    monkeypatch.setattr(geometry_plan, "shown", lambda frame: frame)
    monkeypatch.setattr(geometry_plan, "view_of", view)
    frames = [SimpleNamespace(path=Path(name)) for name in ("a.dng", "b.dng", "c.dng")]
    assert geometry_plan.chart_views(frames, SimpleNamespace(chart=None)) == (
        ["view"],
        ["a.dng: no chart", "c.dng: dark"],
    )
