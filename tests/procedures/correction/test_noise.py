import cv2
import numpy as np
import pytest

from procedures.correction.checks import LEAST_RISE
from procedures.correction.noise import noise_of
from procedures.outcome import BadInput
from procedures.raw import Plane

from .lens_photographs import Sensor
from .small_lens import scene


@pytest.fixture(scope="module")
def samples():
    """Samples of a sensor whose white is 20000 electrons."""
    light = cv2.GaussianBlur(scene((360, 480))[0], (0, 0), 3)
    return Sensor(white_e=20000.0).read(light, np.random.default_rng(3))


def test_variance_grows_with_light_like_photon_noise(samples):
    noise = noise_of(Plane("Y", samples, 1 / 16383))
    for level in (0.2, 0.4, 0.6):
        truth = level / 20000 + (6 / 20000) ** 2
        # edges are everywhere in this scene: their contribution is counted as noise, which is conservative
        assert 0.8 * truth < noise.variance_at(np.array(level)) < 1.5 * truth
    assert noise.whiteness == pytest.approx(1, abs=0.15)
    assert noise.rise > 1


@pytest.mark.parametrize("how", ["smoothed", "enlarged", "demosaicked"])
def test_processed_samples_are_detected_by_their_noise(samples, how):
    if how == "smoothed":
        processed = cv2.GaussianBlur(samples, (0, 0), 0.8)
    elif how == "enlarged":
        processed = cv2.resize(samples, None, fx=1.5, fy=1.5, interpolation=cv2.INTER_LINEAR)
    else:
        sparse = np.zeros_like(samples)
        sparse[::2, ::2] = samples[::2, ::2]
        processed = cv2.filter2D(sparse, -1, np.outer([0.5, 1, 0.5], [0.5, 1, 0.5]).astype(np.float32))
    assert noise_of(Plane("Y", processed, 1 / 16383)).whiteness < 0.35


def test_a_tone_curve_is_detected_by_noise_that_falls_with_light():
    # photons' variance L becomes L^(1 - 2 (1 - 1/2.4)) = L^-0.17: over two decades a half
    light = np.tile(np.geomspace(0.009, 0.9, 480), (360, 1))
    samples = Sensor(white_e=60000.0, read_e=1.0).read(light, np.random.default_rng(3))
    curved = np.maximum(samples, 0) ** (1 / 2.4)
    assert noise_of(Plane("Y", samples, 1 / 16383)).rise > 1
    assert noise_of(Plane("Y", curved.astype(np.float32), 1 / 16383)).rise < LEAST_RISE


def test_noise_is_at_least_that_of_rounding():
    noise = noise_of(Plane("Y", np.full((64, 64), 0.5, np.float32), 0.01))
    assert noise.variance_at(np.array(0.5)) >= 0.01**2 / 12 * 0.999


def test_a_plane_without_a_block_inside_is_refused():
    noise = np.random.default_rng(1).random((20, 400), dtype=np.float32)
    with pytest.raises(BadInput, match="24 x 24 pixels or more; got 400 x 20"):
        noise_of(Plane.from_array(noise))
