"""The PSF from the noise chart and from a wall, through the same simulated optics."""

import numpy as np
import pytest

from procedures.pattern_psf.estimate import PatternParameters
from procedures.pattern_psf.estimate import estimate_psf as from_chart
from simulators.camera.optics import Optics

from ..pattern_psf.conftest import CHART, PITCH_UM, photograph
from .wall import estimate, photographs

OPTICS = Optics.typical(f_number=5.6, pitch_um=PITCH_UM, gaussian_px=0.3)
NOISE = 0.004


def otf(fx: np.ndarray, fy: np.ndarray) -> np.ndarray:
    return np.real(OPTICS.otf(np.asarray(fx), np.asarray(fy)))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.nightly)])
def test_chart_and_wall_agree_within_their_errors(seed: int) -> None:
    rng = np.random.default_rng(seed)
    chart = from_chart(photograph(gaussian_px=0.3).plane(NOISE, rng), CHART, PatternParameters(3, 13)).result()
    pair = photographs(otf, noise=NOISE, seed=seed, size=150)
    wall = estimate(pair.near, pair.far).result()
    for axis in ("horizontal", "vertical"):
        one, other = (result.quality.numbers[f"mtf50_{axis}"] for result in (chart, wall))
        assert abs(one.value - other.value) < 2.5 * np.hypot(one.uncertainty, other.uncertainty)
        assert other.value == pytest.approx(one.value, rel=0.01)
