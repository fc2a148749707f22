"""Plan of the two photographs: checks of wall and light, and the resulting PSF."""

from collections.abc import Hashable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from procedures.outcome import BadParameter, Outcome, Verdict
from procedures.plan import Shoot, facts_as
from procedures.raw import Plane, RawFrame
from procedures.reading.exposure import Exposure
from procedures.two_photo.distances import times_as_far
from procedures.two_photo.facts import TwoPhotoFacts
from procedures.two_photo.plan import (
    check_far,
    check_near,
    enough,
    estimate,
    farther_stops,
    further,
    mean_plane,
    plan,
    predicted,
    reach_of_rail,
    sharpness,
)  # fmt: skip
from procedures.two_photo.sharpness import fineness

from .wall import TEXELS, gaussian, leaves, photograph, samples_of

RATIO = 4.4
FACTS = {"ratio": RATIO, "near_mm": 1000.0}
OTF = gaussian(0.42, 0.37)
NEAR_PX, FAR_PX = 480, 160


def frame(samples, **exposure):
    plane = Plane("Y", samples.astype(np.float32), 1 / 16383)
    return RawFrame(Path("frame.dng"), "", {"Y": plane}, Exposure(**exposure))


@pytest.fixture(scope="module")
def wall():
    """Near and far photographs, two of each; the near ones show the middle of the wall."""
    rng = np.random.default_rng(4)
    texels = leaves(int(FAR_PX * RATIO * TEXELS * 1.05), rng)

    def view(scale, n):
        middle = len(texels) / 2 + 0.3
        return np.array(
            [[scale, 0, middle - scale * (n - 1) / 2], [0, scale, middle - scale * (n - 1) / 2], [0, 0, 1.0]]
        )

    sharp = (
        photograph(texels, view(TEXELS, NEAR_PX), NEAR_PX, OTF, TEXELS),
        photograph(texels, view(TEXELS * RATIO, FAR_PX), FAR_PX, OTF, TEXELS * RATIO),
    )
    return [[0.8 * image + rng.normal(0, 0.003, image.shape) for _ in range(2)] for image in sharp]


def test_a_wall_is_good_by_its_texture_and_light(wall):
    near = check_near(frame(wall[0][0]), FACTS)
    assert near.good, near.say
    far = check_far(frame(wall[1][0]), {**FACTS, **near.facts})
    assert far.good, far.say
    (x0, y0), (x1, _), (_, y1), _ = far.outline.wanted
    assert (x1 - x0, y1 - y0) == pytest.approx((FAR_PX / RATIO, FAR_PX / RATIO))
    rng = np.random.default_rng(1)
    smooth = 0.5 + 0.05 * np.linspace(0, 6, 300) + rng.normal(0, 0.003, (300, 300))
    advice = check_near(frame(smooth), FACTS)
    assert not advice.good
    assert "rougher wall" in advice.say
    advice = check_far(frame(0.6 * wall[1][0]), {**FACTS, **near.facts})
    assert not advice.good
    assert "darker than from nearby" in advice.say


@pytest.mark.parametrize("share", [0.5, 0.65, 1.4, 2.0])
def test_a_near_distance_that_the_laser_contradicts_is_named(wall, share):
    advice = check_near(frame(wall[0][0]), {**FACTS, "near_mm": 1000.0 * share, "distance_mm": 1000.0})
    assert advice.contradictory == ("near_mm",)
    assert check_near(frame(wall[0][0]), {**FACTS, "distance_mm": 1120.0}).good


def test_a_way_that_the_laser_contradicts_is_reported(wall):
    near = check_near(frame(wall[0][0]), {**FACTS, "distance_mm": 1120.0})
    facts = {**FACTS, **near.facts}
    assert check_far(frame(wall[1][0]), {**facts, "distance_mm": 120.0 + RATIO * 1000.0}).good
    advice = check_far(frame(wall[1][0]), {**facts, "distance_mm": 120.0 + 3.0 * 1000.0})
    assert "went back by 2.00 m, and 3.40 m were wanted" in advice.say
    assert advice.moves == {"z_mm": pytest.approx(1400.0)}


GONE = {"far_way_mm": (RATIO - 1) * 1000.0}


@pytest.mark.parametrize(
    ("given", "contradictory"),
    [
        (GONE, ()),
        ({**GONE, "near_mm": 800.0}, ("near_mm",)),
        ({**GONE, "near_mm": 1200.0}, ("near_mm",)),
        ({**GONE, "near_mm": 1200.0, "insisted_near_mm": True}, ()),
        # by hand, where the way is not known: by the ratio alone
        ({}, ()),
        ({"ratio": RATIO / 1.2}, ("near_mm", "ratio")),
        ({"ratio": RATIO / 0.8}, ("near_mm", "ratio")),
    ],
)
def test_a_near_distance_that_both_photographs_contradict_is_named(wall, times, given, contradictory):
    one = {"Y": Outcome(times)}
    assert enough("far", [one, one], {**FACTS, **given}).contradictory == contradictory


@pytest.fixture(scope="module")
def times(wall):
    known: dict[Hashable, Outcome[Any]] = {}
    near, far = (request for step in plan().steps for request in step.requests if isinstance(request, Shoot))
    near.estimate(frame(wall[0][0]), FACTS, [], known)
    return far.estimate(frame(wall[1][0]), FACTS, [], known)["Y"].value


def test_the_photographs_give_the_ratio_of_distances_within_the_rail(wall, times):
    assert times == pytest.approx(RATIO, rel=5e-3)  # a tenth of a pixel over the far one's 160
    there, back = (Plane("Y", wall[i][0].astype(np.float32), 1 / 16383) for i in (1, 0))
    assert times_as_far(there, back) == pytest.approx(1 / RATIO, rel=5e-3)
    advice = check_near(frame(wall[0][0]), {**FACTS, **RAIL})
    assert advice.contradictory == ("near_mm", "ratio")
    assert "is 3.40 m farther back, and the rail goes 1.50 m" in advice.say
    near = check_near(frame(wall[0][0]), {**FACTS, **RAIL, "ratio": 2.4})
    assert near.good
    back = {**FACTS, **near.facts, **RAIL, "at_z_mm": 1400.0}
    assert check_far(frame(wall[1][0]), back).facts["far_way_mm"] == 1400.0


RAIL = {"at_z_mm": 0.0, "low_z_mm": 0.0, "high_z_mm": 1500.0}
ASKS = plan().asks()


@pytest.mark.parametrize(("near_mm", "high_mm"), [(800.0, 1500.0), (360.0, 700.0)])
def test_a_rail_too_short_for_a_sharp_lens_is_named_before_the_first_photograph(near_mm, high_mm):
    with pytest.raises(BadParameter, match=r"at least 3\.2 times the near distance") as error:
        ASKS["near_mm"].check(near_mm, {**RAIL, "high_z_mm": high_mm})
    # from the distance that the remedy names, the rail reaches 3.2 times as far
    assert f"at most {high_mm / 2200:.2f} m" in error.value.remedy
    ASKS["near_mm"].check(high_mm / 2.2 - 1, {**RAIL, "high_z_mm": high_mm})
    ASKS["near_mm"].check(near_mm, {})  # on a tripod


def test_the_proposed_ratio_is_within_the_rail():
    for near_mm, proposed in ((360.0, 4.0), (600.0, 3.5)):
        facts = {**RAIL, "near_mm": near_mm}
        assert ASKS["ratio"].proposed(facts) == pytest.approx(proposed)
        ASKS["ratio"].check(proposed, facts)
    with pytest.raises(BadParameter, match=r"the rail goes 1\.50 m") as error:
        ASKS["ratio"].check(3.6, facts)
    assert "at most 3.5" in error.value.remedy
    with pytest.raises(BadParameter) as error:
        ASKS["ratio"].check(6.0, {**RAIL, "near_mm": 360.0})
    assert "at most 5.1" in error.value.remedy  # 1 + 1500 / 360
    assert ASKS["ratio"].proposed({"near_mm": 360.0}) == 4.0


def test_the_sharper_wall_scores_higher_and_the_mean_of_frames_has_less_noise(wall):
    soft = cv2.GaussianBlur(wall[0][0], (0, 0), 1.0)
    rng = np.random.default_rng(1)
    assert sharpness(frame(wall[0][0]), FACTS) > 1.5 * sharpness(frame(soft + rng.normal(0, 0.003, soft.shape)), FACTS)
    both = mean_plane("Y", [frame(one) for one in wall[0]]).samples
    noise = np.std(wall[0][0] - wall[0][1]) / 2**0.5
    assert np.std(both - wall[0][0]) == pytest.approx(noise / 2**0.5, rel=0.02)


@pytest.mark.slow
def test_near_and_far_photographs_become_the_psf(wall):
    frames = [frame(one) for place in wall for one in place]
    outcome = estimate(frames, {**FACTS, "near_frames": 2.0}, {})["Y"]
    assert outcome.verdict is not Verdict.REFUSED, outcome.reason
    assert outcome.value.scale == pytest.approx((RATIO, RATIO), rel=2e-3)
    truth = samples_of(OTF, 3, 13)
    # the published walls have errors of 2 to 8 per cent; this one is small
    assert np.linalg.norm(outcome.value.psf.h - truth) < 0.1 * np.linalg.norm(truth)


def test_the_second_near_photograph_predicts_the_uncertainty_of_each_distance(wall):
    shoot = next(request for step in plan().steps for request in step.requests if isinstance(request, Shoot))
    known = {}
    results = [shoot.estimate(frame(one), FACTS, [], known) for one in wall[0]]
    advice = shoot.enough(results, FACTS)
    predictions = facts_as(TwoPhotoFacts, advice.facts).predictions
    assert list(predictions) == [3.2, 4.0, 5.0, 6.3]
    # fewer far samples, 1/z^2, and coarser texture
    assert list(predictions.values()) == sorted(predictions.values())
    facts = {**FACTS, **advice.facts}
    assert further(facts) == [3.2, 5.0, 6.3]  # 4.4 times is the far place: 4 times is the same within a tenth
    shown = predicted(facts)
    assert shown.y[0] == predictions[4.0]
    assert shown.y[1] == pytest.approx((predictions[4.0] ** -2 + predictions[3.2] ** -2) ** -0.5)
    assert "one further distance, 3.2 times the near one, lowers that to" in shown.say


def test_further_distances_are_within_the_rail():
    facts = {**FACTS, **RAIL, "high_z_mm": 4500.0, "predicted": "3.2 0.004, 5 0.005, 6.3 0.006", "near_z_mm": 0.0}
    assert further(facts) == [3.2, 5.0]
    shown = reach_of_rail(facts)
    assert shown.x == (3.2, 4.0, 5.0)
    assert "The rail reaches 5.5 times the near distance, 5.50 m from the wall." in shown.say
    facts = {**facts, "farther": 2.0}
    stops = farther_stops(facts)
    assert [stop.name for stop in stops] == ["3.2 times", "5 times"]
    assert stops[1].go.to(facts) == {"z_mm": 4000.0}
    assert "5.00 m from the wall" in stops[1].go.say(facts)
    goal = stops[0].goal(facts)
    # the far photographs, 4.4 times as far, count as those of 5 times: 0.005; the first stop adds 0.004
    assert (goal.left, goal.now) == (2, 0.005)
    assert goal.after == pytest.approx((0.005**-2 + 0.004**-2) ** -0.5)
    assert goal.say.startswith(
        "MTF at Nyquist by noise: ± 0.005 now, ± 0.0031 after the next photograph; 2 photographs"
    )
    assert farther_stops({**facts, "farther": 0.0}) == []


@pytest.mark.slow
def test_further_photographs_join_the_estimate(wall):
    frames = [frame(one) for place in wall for one in place]
    two = estimate(frames, {"near_frames": 2.0, "far_frames": 2.0}, {})["Y"].value
    three = estimate([*frames, frame(wall[1][0])], {"near_frames": 2.0, "far_frames": 2.0, "farther": 1.0}, {})[
        "Y"
    ].value
    assert (two.diagnostics.get("photographs", 2), three.diagnostics["photographs"]) == (2, 3)


def test_a_photograph_smaller_than_a_patch_is_as_fine_as_a_large_one(rng):
    noise = rng.normal(0, 1, (400, 400)).astype(np.float32)
    # white: as much power in both bands, whatever the size; 40 x 52 has some hundred frequencies in a band
    assert fineness(noise, 0.0) == pytest.approx(1.0, abs=0.05)
    assert fineness(noise[:40, :52], 0.0) == pytest.approx(1.0, abs=0.3)
