"""Checks of a picture by the guided sensor measurement, with and without a controlled panel."""

import math
from pathlib import Path

import numpy as np
import pytest

from procedures.plan import facts_as
from procedures.raw import Plane, RawFrame
from procedures.reading.exposure import Exposure
from procedures.sensor.plan import LIT, TRIAL_LEVEL, SensorFacts, check_panel, check_picture, ladder

HASH = "abcdef0123456789" * 4
BY_PANEL = {"light_level": 0.5, "exposure_s": 0.02, "iso": 100.0}
BY_TIME = {"exposure_s": 0.02, "iso": 100.0, "ladder_s": 0.08}


def frame(level, seconds=0.02, slope=0.0):
    samples = np.full((30, 30), level, dtype=np.float32) * (1 + slope * np.linspace(-1, 1, 30, dtype=np.float32))
    return RawFrame(
        Path("a.dng"), HASH, {"G1": Plane("G1", samples, 1 / 16000)}, Exposure(exposure_s=seconds, iso=100.0)
    )


def test_levels_and_exposure_reach_saturation_under_even_light():
    steps = np.array(ladder(24)) * 255
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert len(steps) == 24
    assert steps[-1] == 255
    dark = check_panel(frame(0.1), {"light_level": TRIAL_LEVEL})
    assert not dark.good
    assert 2 ** dark.by_hand["exposure_ev"] * 0.1 == pytest.approx(0.51, rel=0.13)  # thirds of a stop
    assert check_panel(frame(1.0), {"light_level": TRIAL_LEVEL}).by_hand["exposure_ev"] == pytest.approx(-1, abs=0.1)
    assert check_panel(frame(0.5), {"light_level": TRIAL_LEVEL}).facts["exposure_s"] == 0.02
    assert "differs by" in check_panel(frame(0.5, slope=0.3), {"light_level": TRIAL_LEVEL}).say
    advice = check_picture(0.5, frame(0.3), BY_PANEL)
    assert advice.good
    assert advice.facts == {LIT + HASH[:16]: 0.5}
    assert facts_as(SensorFacts, advice.facts).lit == {HASH[:16]: 0.5}


@pytest.mark.parametrize(
    ("light", "level", "seconds", "known", "words"),
    [
        (0.25, 0.3, 0.02, BY_PANEL, "panel is at 0.500"),
        (0.5, 0.3, 0.04, BY_PANEL, "exposure time is 0.04 s"),
        (0.0, 0.3, 0.02, {**BY_PANEL, "light_level": 0.0}, "light in a dark picture"),
    ],
)
def test_another_light_or_time_is_refused(light, level, seconds, known, words):
    advice = check_picture(light, frame(level, seconds), known)
    assert not advice.good
    assert words in advice.say


def test_without_a_panel_the_exposure_time_makes_the_ladder():
    first = check_picture(0.5, frame(0.3, 0.02), BY_TIME)
    assert not first.good
    assert first.by_hand["exposure_ev"] == pytest.approx(math.log2(0.04 / 0.02), abs=0.2)
    then = check_picture(0.5, frame(0.6, 0.04), BY_TIME)
    assert then.facts == {LIT + HASH[:16]: 0.04}
