"""Turns of the chart in the guided geometry: in steps robust to distortion, by hand or by the bench."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from procedures.geometry import plan as geometry_plan
from procedures.geometry.facts import GeometryFacts, as_pose, place_of
from procedures.geometry.next_view import NextView
from procedures.geometry.plan import STEP_DEG, turn_chart
from procedures.outcome import BadParameter, Outcome, Verdict
from procedures.pattern_psf.pose import ChartPose
from procedures.plan import Reading, facts_as

READINGS = tuple(Reading(name, value, "°", -7.0, 7.0) for name, value in (("off", 0.0), ("yaw", 40.0), ("pitch", 0.0)))
WANTED = NextView((0.5, 0.5), -35.0, 0.0, 1000.0, 0.4, 0.3)


@pytest.mark.parametrize(("present", "turn"), [(6.0, -STEP_DEG), (-24.0, -11.0), (35.0, -70.0)])
def test_a_nearly_frontal_chart_is_turned_in_two_steps(present, turn):
    advice = turn_chart(ChartPose((0.0, 0.0, 1000.0), present, 0.0, 0.0), WANTED, READINGS, ())
    assert advice.by_hand["chart_yaw_deg"] == turn
    assert advice.moves == advice.by_hand  # for a bench with these axes
    assert f"by {abs(turn):.0f}°, its {'right' if turn > 0 else 'left'} edge nearer" in advice.say


def test_poses_are_placed_and_views_planned_where_they_matter_most():
    turned = as_pose(ChartPose((1.0, 2.0, 3.0), 90.0, 0.0, 0.0))
    np.testing.assert_allclose(turned.R @ [1, 0, 0], [0, 0, -1], atol=1e-12)  # yaw: its right edge nearer
    np.testing.assert_allclose(as_pose(ChartPose((0, 0, 1.0), 0.0, 0.0, 90.0)).R @ [1, 0, 0], [0, 1, 0], atol=1e-12)
    np.testing.assert_array_equal(turned.t, [1, 2, 3])
    camera = geometry_plan.nominal_camera((20, 30), 50.0)
    np.testing.assert_allclose(camera.project(np.array([[0.0, 0, 1], [0.1, 0.2, 1]])), [[14.5, 9.5], [19.5, 19.5]])
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
        return Outcome("view", Verdict.PASS) if name == "b.dng" else Outcome(None, Verdict.REFUSED, "dark", "light")

    monkeypatch.setattr(geometry_plan, "shown", lambda frame: frame)
    monkeypatch.setattr(geometry_plan, "view_of", view)
    frames = [SimpleNamespace(path=Path(name)) for name in ("a.dng", "b.dng", "c.dng")]
    assert geometry_plan.chart_views(frames, SimpleNamespace(chart=None)) == (
        ["view"],
        ["a.dng: dark", "c.dng: dark"],
    )
