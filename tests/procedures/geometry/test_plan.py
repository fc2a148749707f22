"""Turns of the chart in the guided geometry: in steps robust to distortion, by hand or by the bench."""

from __future__ import annotations

import pytest

from procedures.geometry.next_view import NextView
from procedures.geometry.plan import STEP_DEG, turn_chart
from procedures.pattern_psf.pose import ChartPose
from procedures.plan import Reading

READINGS = tuple(Reading(name, value, "°", -7.0, 7.0) for name, value in (("off", 0.0), ("yaw", 40.0), ("pitch", 0.0)))
WANTED = NextView((0.5, 0.5), -35.0, 0.0, 1000.0, 0.4, 0.3)


@pytest.mark.parametrize(("present", "turn"), [(6.0, -STEP_DEG), (-24.0, -11.0), (35.0, -70.0)])
def test_a_nearly_frontal_chart_is_turned_in_two_steps(present, turn):
    advice = turn_chart(ChartPose((0.0, 0.0, 1000.0), present, 0.0, 0.0), WANTED, READINGS, ())
    assert advice.by_hand["chart_yaw_deg"] == turn
    assert advice.moves == advice.by_hand  # for a bench with these axes
    assert f"by {abs(turn):.0f}°, its {'right' if turn > 0 else 'left'} edge nearer" in advice.say
