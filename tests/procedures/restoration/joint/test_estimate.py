from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, rotate, shift

from procedures import BadInput, BadParameter, Refused, Scheme, Verdict
from procedures.restoration.joint.estimate import RestorationParameters, judge, noise_gain, noise_of, reach_of, restore
from procedures.restoration.joint.picture_error import noise_upper_bound
from procedures.restoration.joint.result import refocused
from procedures.restoration.masks.blur_models import mask_stack, pillbox
from procedures.restoration.masks.checks import check_max_w, without_defects
from tests.procedures.restoration.conftest import scene

SLOW_FIXTURES = {"outcome"}
QUICK = RestorationParameters(scheme=Scheme(3, 4, 4, 1, 6))


@pytest.fixture(scope="module")
def outcome(vibrating):
    return restore(list(vibrating.z), vibrating.stacks, RestorationParameters(scheme=Scheme(6, 6, 6, 2, 10)))


def test_a_good_pair_passes_with_noise_estimated_and_a_residual_close_to_it(outcome, vibrating):
    assert outcome.verdict == Verdict.PASS, outcome.reason
    assert outcome.value.sharp.shape == (1, 96, 112)
    assert vibrating.picture_error(outcome.value.sharp) < 8
    assert vibrating.depth_error(outcome.value.w) < 0.2
    true = 0.01 * vibrating.z.std()
    # the levels' spacing and the edge add to it, the minimum over levels subtracts
    assert 0.5 * true < noise_of(vibrating.z, vibrating.stacks) < 3 * true
    rng = np.random.default_rng(4)
    scene = gaussian_filter(rng.standard_normal((120, 120)), 4)
    scene /= 4 * scene.std()
    z = np.clip(scene + 0.01 * rng.standard_normal((2, 1, 120, 120)), 0, None)
    # half of the ground is clipped at black; the upper quartile is then below the noise, by less than a third
    assert noise_upper_bound(z) == pytest.approx(0.01, rel=0.33)
    assert noise_upper_bound(0.5 + 0 * z + 0.01 * rng.standard_normal(z.shape)) == pytest.approx(0.01, rel=0.05)
    assert outcome.value.diagnostics.residual_over_noise < 1


def test_pixels_hot_in_all_photographs_are_replaced(vibrating):
    spoilt = vibrating.z.copy()
    spoilt[:, 0, [0, 50, 95], [60, 50, 111]] = 1.5
    spoilt[0, 0, 30, 30] = 1.5  # in one alone it may be detail
    mended = without_defects(spoilt)
    assert np.count_nonzero(mended != vibrating.z) == 7
    assert mended[0, 0, 30, 30] == 1.5
    assert np.abs(np.delete((mended - vibrating.z)[0, 0].ravel(), 30 * 112 + 30)).max() < 0.1


@pytest.mark.slow
def test_photographs_of_two_scenes_are_refused(vibrating):
    pair = [vibrating.z[0], vibrating.z[1][:, :, ::-1]]
    judged = restore(pair, vibrating.stacks, QUICK)
    assert judged.verdict == Verdict.REFUSED
    assert judged.value is None
    assert "no picture explains the photographs: the residual is" in judged.reason
    # unrelated photographs have a residual of their contrast relative to the mean of both: 1 / sqrt(2)
    residual = float(judged.reason.split(" and ")[1].split("%")[0])
    assert residual == pytest.approx(100 / 2**0.5, rel=0.15)


def test_uncertainty_of_the_picture_decides_between_pass_doubt_and_refusal(outcome, vibrating, vibration_shapes):
    # without the edges of the depth and the frame's rim; the prior assumes the detail of this scene
    error = vibrating.picture_error(outcome.value.sharp) / 255
    assert outcome.value.diagnostics.picture_std == pytest.approx(error, rel=0.5)
    # a shape rotated by 20 degrees represents an inaccurate measurement
    turned = mask_stack(rotate(vibration_shapes[1], 20, reshape=False, order=1).clip(0), 4.6, R=6)
    judged = restore(list(vibrating.z), [vibrating.stacks[0], turned], QUICK)
    assert judged.verdict == Verdict.DOUBTFUL
    assert "the shapes are inaccurate: in excess of noise" in judged.reason
    assert "the picture is uncertain by" in judged.reason
    d = judged.value.diagnostics
    assert 0.01 < d.unexplained < 0.1
    # the true error is larger than estimated, as a common error of both photographs is invisible
    error = vibrating.picture_error(judged.value.sharp) / 255
    assert 2 * outcome.value.diagnostics.picture_std < d.picture_std < error
    # a residual above the noise enters the picture's uncertainty, which must then be small relative to the blur
    cases = ((1.0, 1.3, "pass"), (1.3, 2.9, "doubtful"), (1.3, 3.1, "pass"), (4.9, 2.9, "doubtful"))
    for times, gained, verdict in (*cases, (5.1, 9.0, "refused"), (68.0, 9.0, "refused")):
        judged = replace(
            outcome.value.diagnostics, residual_over_noise=times, elsewhere_over_noise=times, gained=gained
        )
        assert judge(replace(outcome.value, diagnostics=judged)).verdict == verdict
    judged = replace(outcome.value.diagnostics, residual_over_noise=1.0, elsewhere_over_noise=1.0, gained=1.0)
    doubtful = judge(replace(outcome.value, diagnostics=judged))
    assert doubtful.verdict == Verdict.DOUBTFUL
    assert "restoring gains nothing" in doubtful.reason
    assert "use the photograph" in doubtful.remedy


def test_negative_light_beyond_the_expected_error_is_doubtful(outcome):
    # the error is at least the negative part, as the scene has none
    result = outcome.value
    error = result.diagnostics.picture_std
    for level, verdict in ((-0.9 * error, "pass"), (-1.1 * error, "doubtful")):
        judged = judge(replace(result, sharp=np.full_like(result.sharp, level)))
        assert judged.verdict == verdict
        assert ("negative light" in judged.reason) == (verdict == "doubtful")


@pytest.mark.slow
@pytest.mark.parametrize("noise_db", [26.0, 14.0])
def test_expected_gain_is_the_true_one_from_symmetric_starts(noise_db):
    # a defocus pair of little blur: at 14 dB the restored picture is no better than the photograph
    stacks = [mask_stack(pillbox(), 4.4, ratio=ratio, R=7) for ratio in (1.0, 1.25)]
    truth = scene(stacks, (72, 84), noise_db, 5)
    restored = restore(list(truth.z), stacks, RestorationParameters(depth_start="symmetric")).value
    photograph = min(truth.picture_error(one) for one in truth.z)
    gain = photograph / truth.picture_error(restored.sharp)
    assert restored.diagnostics.gained == pytest.approx(gain, rel=0.3)


def test_uncertainties_of_picture_and_depth_are_stated_at_every_pixel(outcome, vibrating):
    judged = replace(outcome.value.diagnostics, residual_over_noise=3.9, gained=1.0, undetermined=1.0)
    assert "in one order" in judge(replace(outcome.value, diagnostics=judged)).remedy
    judged = replace(judged, undetermined=0.1)
    assert "in one order" not in judge(replace(outcome.value, diagnostics=judged)).remedy
    result, R, rim = outcome.value, vibrating.R, slice(12, -12)
    error = np.abs(result.sharp[0] - vibrating.sharp[0, R:-R, R:-R])
    # 95 % of a normal distribution; edges of the depth are included
    assert 0.85 < np.mean(error[rim, rim] < 2 * result.sharp_std[rim, rim]) < 0.99
    spread = outcome.value.w_std
    assert spread.shape == outcome.value.w.shape
    assert 0 < np.median(spread) < 0.2
    result = outcome.value
    view = refocused(result, vibrating.stacks[0], 2.0, 2.0)
    change = gaussian_filter((view - result.sharp)[0] ** 2, 3)
    inside = (slice(10, -10), slice(10, -10))
    at = np.abs(result.w - 2.0)
    assert change[inside][at[inside] < 0.1].mean() < 0.1 * change[inside][at[inside] > 1].mean()


@pytest.mark.slow
def test_a_wrong_ratio_is_doubtful_colours_share_one_depth_and_saturation_is_excluded(vibrating, vibration_stacks):
    swapped = restore(list(vibrating.z), vibration_stacks[::-1], QUICK)
    assert swapped.verdict == Verdict.DOUBTFUL
    assert "times the noise" in swapped.reason
    assert swapped.remedy
    z = np.concatenate([vibrating.z, 0.6 * vibrating.z], axis=1)
    result = restore(
        list(z), vibrating.stacks, RestorationParameters(scheme=Scheme(2, 4, 4, 1, 4), total_variation=True)
    )
    assert result.value.sharp.shape == (2, 96, 112)
    assert np.median(result.value.sharp[1] / result.value.sharp[0]) == pytest.approx(0.6, abs=0.02)
    z = vibrating.z.copy()
    z[0, 0, 40:44, 50:54] = 1.0
    result = restore(list(z), vibrating.stacks, QUICK).value
    assert result.diagnostics.saturated == pytest.approx(16 / z[:, 0].size)
    assert result.sharp[0, 40:44, 50:54].max() < 1.3


@pytest.mark.parametrize("start", ["symmetric", "blur"])
def test_the_thesis_s_initial_depths_work(vibrating, start):
    parameters = RestorationParameters(scheme=Scheme(1, 4, 4, 1, 4), depth_start=start)
    assert restore(list(vibrating.z), vibrating.stacks, parameters).value.w.shape == (96, 112)


def spoiled(z):
    rng = np.random.default_rng(0)
    flat = 0.5 + 0.001 * rng.standard_normal(z.shape)
    displaced = np.stack([z[0], shift(z[1], (0, 0, 30)[-z[1].ndim :], mode="wrap")])
    white = np.where(z > np.median(z), 1.0, z)
    return {
        "identical": ([z[0], z[0]], BadInput, "identical"),
        "sizes": ([z[0], z[1][:, :-3]], BadInput, "of one size"),
        "colours": ([z[0], np.concatenate([z[1]] * 3)], BadInput, "got 1, 3"),
        "one": ([z[0]], BadInput, "two photographs"),
        "nan": ([z[0], z[1] * np.nan], BadInput, "must be finite"),
        "flat": (list(flat), Refused, "need texture"),
        "saturated": (list(white), Refused, "saturated"),
        "shifted": (list(displaced), Refused, "shifted"),
    }


@pytest.mark.parametrize("kind", ["identical", "sizes", "colours", "one", "nan", "flat", "saturated", "shifted"])
def test_bad_photographs_are_refused_with_reason(vibrating, kind):
    photographs, error, complaint = spoiled(vibrating.z)[kind]
    with pytest.raises(error, match=complaint) as refusal:
        restore(photographs, vibrating.stacks, QUICK)
    assert refusal.value.remedy


def test_equal_blurs_and_masks_as_large_as_the_photograph_are_refused(vibrating):
    with pytest.raises(BadParameter, match="equally"):
        restore(list(vibrating.z), [vibrating.stacks[0]] * 2, QUICK)
    with pytest.raises(BadParameter, match="too large"):
        restore([p[:, :20, :20] for p in vibrating.z], vibrating.stacks, QUICK)


@pytest.mark.parametrize("w", [0.0, -3.0, 100.0, float("nan")])
def test_impossible_ranges_of_w_are_refused(w):
    with pytest.raises(BadParameter, match="max w"):
        check_max_w(w)


def test_wrong_parameters_are_refused_and_noise_gain_falls_with_the_weight(vibration_stacks):
    with pytest.raises(BadParameter, match="depth start"):
        RestorationParameters(depth_start="best")
    with pytest.raises(BadParameter, match="image weight"):
        RestorationParameters(image_weight=-1.0)
    gains = [noise_gain(vibration_stacks, 2.5, weight) for weight in (1e-4, 1e-2)]
    assert gains[0] > gains[1] > 0
    assert reach_of(np.full((10, 10), 3.0), vibration_stacks) >= 2 * 3 + 5
