import numpy as np
import pytest

from procedures.pattern_psf.radiometry import measure_light, quadratic

from .conftest import Bench


def test_levels_follow_the_light(bench: Bench) -> None:
    _, registration = bench.marks()
    light = measure_light(bench.clean.astype(np.float32), registration, 1e-5)
    points = np.array([[60.0, 60.0], [105.0, 100.0], [150.0, 140.0], [150.0, 60.0]])
    place = quadratic(*((points - registration.centre) / registration.radius).T)
    true_light = 0.9 * (
        1
        + np.array([0.06, -0.04]) @ ((points - [105, 100]) / 60).T
        + np.einsum("ij,j->i", _second_order((points - [105, 100]) / 60), np.array([0.02, 0.01, -0.02]))
    )
    white, black = place @ light.white / true_light, place @ light.black / true_light
    # the light's form is the model's own, but blurred neighbours tint the blocks' rims: a part in a hundred
    assert np.ptp(white) / white.mean() < 0.01
    # ink of 0.04 on paper of 0.9; diffraction's tail carries up to 2 % of the white around into the black blocks
    assert 0.04 < 0.9 * black.mean() / white.mean() < 0.06


def _second_order(p: np.ndarray) -> np.ndarray:
    return np.stack([p[:, 0] ** 2, p[:, 0] * p[:, 1], p[:, 1] ** 2], axis=1)


def test_levels_and_noise_of_the_blocks_withstand_clipping_shade_and_specks(bench, rng):
    _, registration = bench.marks()
    light = measure_light(bench.plane(0.02, rng).samples, registration, 1e-5)
    # some 700 pixels a colour: a variance known to sqrt(2/700) = 5 %, three of these, and what blur leaves in
    assert light.variance_white == pytest.approx(0.02**2, rel=0.2)
    assert light.variance_black == pytest.approx(0.02**2, rel=0.2)
    brighter = np.minimum(2 * bench.clean, 1.0).astype(np.float32)
    assert measure_light(brighter, registration, 1e-5).saturated > 0.9
    corners, registration = bench.marks()
    samples = bench.clean.astype(np.float32)
    honest = measure_light(samples, registration, 1e-5)
    x, y = corners[0].astype(int)
    shaded = samples.copy()
    shaded[y - 6 : y + 8, x + 8 : x + 22] *= 0.3
    found = measure_light(shaded, registration, 1e-5)
    assert abs(found.contrast / honest.contrast - 1) < 0.01
    _, registration = bench.marks()
    clean = bench.plane(0.01, rng).samples
    honest = measure_light(clean, registration, 1e-5)
    specked = clean.copy()
    specked[rng.random(clean.shape) < 0.03] = 0.05
    found = measure_light(specked, registration, 1e-5)
    # a twentieth of the white samples fewer changes a variance known to 5 % by 1 %; six deviations are one in 10^8
    assert found.variance_white == pytest.approx(honest.variance_white, rel=0.1)
    assert found.contrast == pytest.approx(honest.contrast, rel=0.005)
