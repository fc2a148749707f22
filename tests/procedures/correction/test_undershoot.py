import cv2
import numpy as np

from procedures.correction.undershoot import bounded


def test_dark_rims_are_bounded_by_the_flat_part_but_darker_samples_are_not():
    light = np.full((1, 40, 80), 0.02, np.float32)
    light[..., 40:] = 0.8
    light[..., 15] = 0.0  # a line darker than its surroundings, also in the samples
    samples, noise = cv2.GaussianBlur(light[0], (0, 0), 1.0)[None], np.full_like(light, 0.001)
    restored = light.copy()
    restored[..., 37:40], restored[..., 15] = 0.005, -0.01
    out = bounded(restored, samples, noise)
    np.testing.assert_allclose(out[..., 37:40], 0.019, atol=1e-4)
    np.testing.assert_array_equal(np.delete(out, [37, 38, 39], -1), np.delete(restored, [37, 38, 39], -1))
