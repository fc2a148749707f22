from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, rotate, shift

from procedures.outcome import BadInput, BadParameter, Refused, Verdict
from procedures.restoration.joint.estimate import RestorationParameters, judge, noise_gain, noise_of, reach_of, restore
from procedures.restoration.joint.picture_error import own_noise
from procedures.restoration.joint.result import refocused
from procedures.restoration.joint.schedule import Scheme
from procedures.restoration.masks.blur_models import mask_stack
from procedures.restoration.masks.checks import check_max_w

SLOW_FIXTURES = {"outcome"}
QUICK = RestorationParameters(scheme=Scheme(3, 4, 4, 1, 6))


@pytest.fixture(scope="module")
def outcome(vibrating):
    return restore(list(vibrating.z), vibrating.stacks, RestorationParameters(scheme=Scheme(6, 6, 6, 2, 10)))


@pytest.mark.slow
def test_a_good_pair_passes(outcome, vibrating):
    assert outcome.verdict == Verdict.PASS, outcome.reason
    assert outcome.value.sharp.shape == (1, 96, 112)
    assert vibrating.picture_error(outcome.value.sharp) < 8
    assert vibrating.depth_error(outcome.value.w) < 0.2


def test_the_noise_is_found(vibrating):
    true = 0.01 * vibrating.z.std()
    # the levels' spacing and the step add to it, the least over levels takes away
    assert 0.5 * true < noise_of(vibrating.z, vibrating.stacks) < 3 * true


def test_a_photograph_tells_its_own_noise():
    rng = np.random.default_rng(4)
    scene = gaussian_filter(rng.standard_normal((120, 120)), 4)
    scene /= 4 * scene.std()
    z = np.clip(scene + 0.01 * rng.standard_normal((2, 1, 120, 120)), 0, None)
    # half of the ground is clipped at black; the upper quartile then stands below the noise, by less than a third
    assert own_noise(z) == pytest.approx(0.01, rel=0.33)
    assert own_noise(0.5 + 0 * z + 0.01 * rng.standard_normal(z.shape)) == pytest.approx(0.01, rel=0.05)


@pytest.mark.slow
def test_what_is_left_over_is_near_the_noise(outcome):
    assert outcome.value.diagnostics.residual_over_noise < 1


@pytest.mark.slow
def test_photographs_of_two_scenes_are_refused(vibrating):
    pair = [vibrating.z[0], vibrating.z[1][:, ::-1, ::-1]]
    told = restore(pair, vibrating.stacks, QUICK)
    assert told.verdict == Verdict.REFUSED
    assert told.value is None
    assert "no picture explains the photographs: the residual is" in told.reason
    # what has nothing in common leaves about its own contrast over the mean of both: 1 / sqrt(2)
    left = float(told.reason.split(" and ")[1].split("%")[0])
    assert left == pytest.approx(100 / 2**0.5, rel=0.15)


@pytest.mark.slow
def test_uncertainty_of_the_picture_is_its_error_where_the_masks_are_true(outcome, vibrating):
    # steps of the depth and the frame's rim are not in it, the detail of this scene is what the prior supposes
    error = vibrating.picture_error(outcome.value.sharp) / 255
    assert outcome.value.diagnostics.picture_std == pytest.approx(error, rel=0.5)


@pytest.mark.slow
def test_bent_paths_are_doubted_with_what_they_cost(vibrating, vibration_shapes, outcome):
    # a shape turned by 20 degrees stands for one that was measured badly
    turned = mask_stack(rotate(vibration_shapes[1], 20, reshape=False, order=1).clip(0), 4.6, R=6)
    told = restore(list(vibrating.z), [vibrating.stacks[0], turned], QUICK)
    assert told.verdict == Verdict.DOUBTFUL
    assert "the shapes are off: beyond noise they leave" in told.reason
    assert "the picture is uncertain by" in told.reason
    d = told.value.diagnostics
    assert 0.01 < d.unexplained < 0.1
    # it costs, and more than is said: what both photographs share of the error is not seen
    error = vibrating.picture_error(told.value.sharp) / 255
    assert 2 * outcome.value.diagnostics.picture_std < d.picture_std < error


def test_residual_decides_between_pass_doubt_and_refusal(outcome):
    # more than noise is left over: it is in the picture's uncertainty, which then has to be small beside the blur
    cases = ((1.0, 1.0, "pass"), (1.3, 2.9, "doubtful"), (1.3, 3.1, "pass"), (4.9, 2.9, "doubtful"))
    for times, gained, verdict in (*cases, (5.1, 9.0, "refused"), (68.0, 9.0, "refused")):
        told = replace(outcome.value.diagnostics, residual_over_noise=times, elsewhere_over_noise=times, gained=gained)
        assert judge(replace(outcome.value, diagnostics=told)).verdict == verdict


def test_photographs_that_no_depth_explains_are_to_be_put_in_order(outcome):
    told = replace(outcome.value.diagnostics, residual_over_noise=3.9, gained=1.0, undetermined=1.0)
    assert "in one order" in judge(replace(outcome.value, diagnostics=told)).remedy
    told = replace(told, undetermined=0.1)
    assert "in one order" not in judge(replace(outcome.value, diagnostics=told)).remedy


def test_every_pixel_of_the_picture_has_an_uncertainty(outcome, vibrating):
    found, R, rim = outcome.value, vibrating.R, slice(12, -12)
    error = np.abs(found.sharp[0] - vibrating.sharp[0, R:-R, R:-R])
    # of a normal distribution 95 %; steps of the depth are in it
    assert 0.85 < np.mean(error[rim, rim] < 2 * found.sharp_std[rim, rim]) < 0.99


def test_uncertainty_of_depth_is_what_noise_allows(outcome):
    spread = outcome.value.w_std
    assert spread.shape == outcome.value.w.shape
    assert 0 < np.median(spread) < 0.2


def test_refocusing_leaves_the_chosen_depth_sharp(outcome, vibrating):
    found = outcome.value
    view = refocused(found, vibrating.stacks[0], 2.0, 2.0)
    change = gaussian_filter((view - found.sharp)[0] ** 2, 3)
    inside = (slice(10, -10), slice(10, -10))
    at = np.abs(found.w - 2.0)
    assert change[inside][at[inside] < 0.1].mean() < 0.1 * change[inside][at[inside] > 1].mean()


@pytest.mark.slow
def test_a_wrong_ratio_is_doubted(vibrating, vibration_stacks):
    swapped = restore(list(vibrating.z), vibration_stacks[::-1], QUICK)
    assert swapped.verdict == Verdict.DOUBTFUL
    assert "times the noise" in swapped.reason
    assert swapped.remedy


@pytest.mark.slow
def test_colour_shares_one_depth(vibrating):
    z = np.concatenate([vibrating.z, 0.6 * vibrating.z], axis=1)
    found = restore(
        list(z), vibrating.stacks, RestorationParameters(scheme=Scheme(2, 4, 4, 1, 4), total_variation=True)
    )
    assert found.value.sharp.shape == (2, 96, 112)
    assert np.median(found.value.sharp[1] / found.value.sharp[0]) == pytest.approx(0.6, abs=0.02)


@pytest.mark.slow
def test_saturated_samples_are_left_out(vibrating):
    z = vibrating.z.copy()
    z[0, 0, 40:44, 50:54] = 1.0
    found = restore(list(z), vibrating.stacks, QUICK).value
    assert found.diagnostics.saturated == pytest.approx(16 / z[:, 0].size)
    assert found.sharp[0, 40:44, 50:54].max() < 1.3


@pytest.mark.parametrize("start", ["symmetric", "blur"])
def test_the_thesis_starts_are_there(vibrating, start):
    parameters = RestorationParameters(scheme=Scheme(1, 4, 4, 1, 4), depth_start=start)
    assert restore(list(vibrating.z), vibrating.stacks, parameters).value.w.shape == (96, 112)


def spoilt(z):
    rng = np.random.default_rng(0)
    flat = 0.5 + 0.001 * rng.standard_normal(z.shape)
    moved = np.stack([z[0], shift(z[1], (0, 0, 30)[-z[1].ndim :], mode="wrap")])
    white = np.where(z > np.median(z), 1.0, z)
    return {
        "identical": ([z[0], z[0]], BadInput, "identical"),
        "sizes": ([z[0], z[1][:, :-3]], BadInput, "differ in size"),
        "one": ([z[0]], BadInput, "two photographs"),
        "nan": ([z[0], z[1] * np.nan], BadInput, "must be finite"),
        "flat": (list(flat), Refused, "no texture"),
        "saturated": (list(white), Refused, "saturated"),
        "shifted": (list(moved), Refused, "shifted"),
    }


@pytest.mark.parametrize("kind", ["identical", "sizes", "one", "nan", "flat", "saturated", "shifted"])
def test_bad_photographs_are_refused_with_reason(vibrating, kind):
    photographs, error, complaint = spoilt(vibrating.z)[kind]
    with pytest.raises(error, match=complaint) as refusal:
        restore(photographs, vibrating.stacks, QUICK)
    assert refusal.value.remedy


def test_equal_blurs_are_refused(vibrating):
    with pytest.raises(BadParameter, match="alike"):
        restore(list(vibrating.z), [vibrating.stacks[0]] * 2, QUICK)


def test_masks_as_large_as_the_photograph_are_refused(vibrating):
    with pytest.raises(BadParameter, match="too large"):
        restore([p[:, :20, :20] for p in vibrating.z], vibrating.stacks, QUICK)


@pytest.mark.parametrize("w", [0.0, -3.0, 100.0, float("nan")])
def test_impossible_ranges_of_w_are_refused(w):
    with pytest.raises(BadParameter, match="max w"):
        check_max_w(w)


def test_wrong_parameters_are_refused():
    with pytest.raises(BadParameter, match="depth start"):
        RestorationParameters(depth_start="best")
    with pytest.raises(BadParameter, match="image weight"):
        RestorationParameters(image_weight=-1.0)


def test_noise_gain_falls_with_the_weight(vibration_stacks):
    gains = [noise_gain(vibration_stacks, 2.5, weight) for weight in (1e-4, 1e-2)]
    assert gains[0] > gains[1] > 0


def test_reach_covers_both_masks_and_the_window(vibration_stacks):
    assert reach_of(np.full((10, 10), 3.0), vibration_stacks) >= 2 * 3 + 5
