"""Noise of paper under light that falls off over it."""

import numpy as np
import pytest

from procedures.corruption.paper import NoiseMeasurement, measure_noise
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
    assert seen.sharpening.sigmas < 3
    # 22 000 pixels: 1.4 % by the count
    assert seen.finest == pytest.approx(1, abs=4 * seen.uncertainty)


def test_sharpening_is_found_in_uneven_light(rng: np.random.Generator) -> None:
    seen = look(masked(NOISE * rng.standard_normal((150, 150)), 0.3, 1.0), 0.0025)
    assert seen.sharpening.sigmas > 3
