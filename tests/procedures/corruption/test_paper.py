"""Noise of paper under light that falls off over it."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from procedures.corruption.noise import DRIFT, MASK_RADII, mask_scores
from procedures.corruption.paper import NoiseMeasurement, flat_noise, measure_noise
from tests.procedures.corruption.test_noise import masked

NOISE = 0.006


def look(noise: np.ndarray, slope: float) -> NoiseMeasurement:
    """At paper whose light falls by `slope` per pixel to the right and half as much downwards."""
    y, x = np.mgrid[: noise.shape[0], : noise.shape[1]] - 75
    picture = (0.65 + slope * (x + y / 2) + noise).astype(np.float32)
    return measure_noise(
        picture, (0.0, 0.65), lambda level: np.full(level.shape, NOISE**2), np.full(noise.shape, np.nan)
    )


@pytest.mark.parametrize("slope", [0.0, 0.0015, 0.0025, 0.005])
def test_uneven_light_is_not_sharpening(slope: float, rng: np.random.Generator) -> None:
    seen = look(NOISE * rng.standard_normal((150, 150)), slope)
    assert mask_scores([seen.paper], (1.0,), [DRIFT])[0].score < 3.5
    # 22 000 pixels: 1.4 % by the count
    assert seen.finest == pytest.approx(1, abs=4 * seen.uncertainty)


def test_sharpening_is_found_in_uneven_light(rng: np.random.Generator) -> None:
    seen = look(masked(NOISE * rng.standard_normal((150, 150)), 0.3, 1.0), 0.0025)
    assert mask_scores([seen.paper], (1.0,), [DRIFT])[0].score > 3


@pytest.mark.parametrize(("amount", "least", "most"), [(0.0, -4.0, 3.5), (0.2, 4.0, 99.0)])
def test_a_mask_is_found_in_the_flat_parts_of_a_scene_of_unknown_noise(amount: float, least: float, most: float):
    rng = np.random.default_rng(5)
    scene = gaussian_filter(rng.standard_normal((240, 320)), 12)
    scene = 0.5 + 0.1 * scene / scene.std() + 0.3 * (np.indices(scene.shape)[1] > 200)
    picture = scene + 0.02 * np.sqrt(scene) * rng.standard_normal(scene.shape)
    picture += amount * (picture - gaussian_filter(picture, 1))
    scores = mask_scores([flat_noise(picture.astype(np.float32))], MASK_RADII, [DRIFT, DRIFT**2])
    assert least < max(one.score for one in scores) < most
