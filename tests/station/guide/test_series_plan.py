"""The guided series over aperture and focus: the advice at each setting, and which setting is the best."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from procedures import BadParameter, read_frame
from procedures.plan import Tour
from station.calibration.series import best_focuses, points_of
from station.guide.plans import series
from tests.station.sessions.short_plan import photographs


def stops(plan, facts):
    (step,) = (one for one in plan.steps if one.name == "series")
    (tour,) = (one for one in step.requests if isinstance(one, Tour))
    return tour.stops(facts)


def test_each_aperture_is_set_with_its_exposure_time_and_checked_in_the_file(tmp_path):
    path = tmp_path / "1.dng"
    path.write_bytes(photographs()["look"])
    frame = read_frame(path)
    facts = {"apertures": "4, 8", "f_number": 4.0}
    wide, narrow = stops(series.aperture_plan(), facts)
    assert wide.go.say(facts) == ""
    assert "f/8, and change the exposure time by +2.0 stops" in narrow.go.say(facts)
    assert dict(narrow.go.by_hand(facts)) == {"aperture_ev": 2.0}
    assert narrow.go.say({**facts, series.NOW: 8.0}) == ""  # where the camera records none
    wrong = replace(frame, exposure=replace(frame.exposure, f_number=4.0))
    assert dict(narrow.check(wrong, facts).by_hand) == {"aperture_ev": 2.0}


@pytest.mark.parametrize("answer", ["8", "4 f/8", "4 100", ""])
def test_an_answer_that_is_no_series_of_apertures_is_refused(answer):
    (ask,) = (one for step in series.aperture_plan().steps for one in step.requests
              if getattr(one, "key", "") == "apertures")  # fmt: skip
    with pytest.raises(BadParameter, match="two f-numbers"):
        ask.check(answer, {})


def test_the_ring_is_turned_step_by_step_to_the_sharpest():
    first, second, *_ = stops(series.focus_plan(), {})
    assert dict(first.go.by_hand({})) == {"focus_steps": -3.0}
    assert second.go.say({series.NOW: -3.0}) == "Turn the focus ring one small step towards infinity."

    def row(step):
        number = {"value": 1 / (1.6 + 0.2 * (step - 0.4) ** 2), "uncertainty": 0.004, "unit": "cycles/pixel"}
        numbers = {"mtf50_horizontal": number, "mtf50_vertical": number}
        plane = SimpleNamespace(verdict="pass", numbers=numbers)
        return SimpleNamespace(sha256=(), noted={"focus_steps": step}, planes={"G1": plane})

    (best,) = best_focuses(points_of([row(step) for step in series.RING]))
    assert best.peak.place == pytest.approx(0.4, abs=1e-6)
    assert best.words.startswith("G1: sharpest at +0.40 ± ")
