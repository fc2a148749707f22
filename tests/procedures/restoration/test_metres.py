import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from procedures import BadParameter, CameraSetting
from procedures.restoration.first_depth.initial_depth import cost_volume, least_level
from procedures.restoration.masks.blur_models import mask_stack, pillbox
from procedures.restoration.metres import (
    BEHIND,
    FRONT,
    MASKS_PX,
    CameraUncertainty,
    ambiguity,
    distances_of,
    unexplained,
)
from procedures.restoration.sampling_bias import without_bias
from tests.benchmarks.restoration_metres import PAD, SCENE, photograph, pixels

from .conftest import scene

SETTING = CameraSetting(12.0, 2.8, 1200.0, 6.0)
EXACT = CameraUncertainty(0.0, 0.0)


@pytest.mark.parametrize(("side", "metres"), [(FRONT, (0.5, 0.8, 1.1)), (BEHIND, (1.3, 2.0, 3.0))])
def test_distances_are_those_of_the_blur(side, metres):
    w = np.abs(SETTING.blur_radius_px(1000 * np.array([metres])))
    np.testing.assert_allclose(distances_of(w, np.full(w.shape, 0.01), SETTING, side).metres, [metres])


def test_uncertainty_of_distances_is_that_of_draws_and_undetermined_ones_are_omitted(rng):
    w = np.abs(SETTING.blur_radius_px(np.array([[700.0, 900.0]])))
    uncertainty = CameraUncertainty(focus=0.01, scale=0.02)
    distances = distances_of(w, np.full(w.shape, 0.04), SETTING, FRONT, uncertainty)
    samples = []
    for _ in range(4000):
        noisy = w + np.hypot(0.04, MASKS_PX) * rng.standard_normal(w.shape)
        number, focus = 2.8 / (1 + 0.02 * rng.standard_normal()), 1200 * (1 + 0.01 * rng.standard_normal())
        samples.append(CameraSetting(12.0, number, focus, 6.0).distance_mm(noisy) / 1000)
    # 4000 draws: 1.1 % by chance; the rest is nonlinearity
    np.testing.assert_allclose(distances.std[0], np.std(samples, axis=0)[0], rtol=0.05)
    assert (distances.common < distances.std).all()
    far = distances_of(np.array([[1.0, SETTING.scale_px_mm / 1200 - 0.01]]), np.full((1, 2), 0.1), SETTING, BEHIND)
    uncertain = distances_of(np.array([[1.0, 1.0]]), np.array([[0.1, 0.6]]), SETTING, FRONT, EXACT)
    for distances in (far, uncertain):
        assert np.isfinite(distances.metres).tolist() == [[True, False]]
        assert np.isnan(distances.std[0, 1])
        assert distances.determined == 0.5


@pytest.mark.parametrize(("side", "focus_mm"), [("left", 1200.0), (BEHIND, np.inf)])
def test_an_unknown_side_is_refused(side, focus_mm):
    with pytest.raises(BadParameter):
        distances_of(np.ones((1, 1)), np.ones((1, 1)), CameraSetting(12.0, 2.8, focus_mm, 6.0), side)


def test_depth_is_ambiguous_without_texture_and_unexplained_with_large_residuals(rng):
    stacks = [mask_stack(pillbox(), 5.2, ratio=ratio, R=7) for ratio in (1.0, 1.25)]
    photographed = scene(stacks, (64, 88), 40.0)
    noise = float(photographed.z.std() * 0.01)
    w = photographed.w[7:-7, 7:-7]
    flat = photographed.z.copy()
    flat[..., 40:] = 0.5 + noise * np.random.default_rng(1).standard_normal(flat[..., 40:].shape)
    spread = ambiguity(list(flat), stacks, w, noise)
    assert np.median(spread[8:24, 8:28]) < 0.25
    assert np.median(spread[8:-8, 56:-8]) > 0.7
    # a depth other than the photographs' is no better for being given
    assert np.median(ambiguity(list(photographed.z), stacks, w + 1, noise)[8:24, 8:28]) > 0.8
    residual = 0.01 * rng.standard_normal((2, 1, 60, 80))
    residual[:, :, 20:40, 50:70] *= 3
    mask = unexplained(residual, 0.01)
    assert mask[24:36, 54:66].all()
    assert not mask[:, :40].any()
    distances = distances_of(np.ones((60, 80)), np.where(mask, np.inf, 0.1), SETTING, FRONT)
    assert (np.isnan(distances.metres) == mask).all()


def test_w_of_masks_summed_over_pixels_is_corrected(rng):
    light = gaussian_filter(rng.standard_normal((SCENE * (96 + 2 * PAD),) * 2), 1)
    sizes, levels = [(1.0, 0.0), (0.8, 0.0)], np.arange(0.3, 3.9, 0.05)
    stacks = [mask_stack(pillbox(), 4.0, ratio=ratio, R=5) for ratio, _ in sizes]
    for w, bias in ((1.05, -0.17), (1.3, -0.1), (1.8, 0.0)):
        z = np.stack([photograph(light, np.full(light.shape, ratio * w))[None] for ratio, _ in sizes])
        cost = cost_volume(z, stacks, np.ones(2), levels, 1)[20:-20, 20:-20].mean(axis=(0, 1))
        found = least_level(cost[None, None], levels)
        assert found == pytest.approx(w + bias, abs=0.06)
        assert without_bias(found, pillbox(), sizes, stacks, pixels(light)[None])[0] == pytest.approx(w, abs=0.08)
    assert without_bias(np.array([[0.4]]), pillbox(), sizes, stacks, z[0])[0] == 0.4
