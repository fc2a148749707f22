import cv2
import numpy as np
import pytest

from procedures.corruption.directions import ADAPTIVE_PX, FAINT, adaptive, gain_along, mask, mask_gain

F = np.array([0.05, 0.1, 0.2, 0.3, 0.4])


def test_the_gain_along_a_linear_filter_is_its_transfer_function(rng):
    picture = cv2.GaussianBlur(rng.standard_normal((200, 220)), (0, 0), 0.7)
    np.testing.assert_allclose(gain_along(mask(picture, 1.5), picture, F), mask_gain(F, 1.5), atol=0.03)


@pytest.mark.parametrize(("contrast", "expected"), [(0.03 * FAINT, True), (30 * FAINT, False)])
def test_adaptive_smoothing_takes_the_mean_of_faint_detail_and_keeps_strong_detail(rng, contrast, expected):
    picture = contrast * rng.standard_normal((80, 80))
    twice = cv2.blur(cv2.blur(picture, (ADAPTIVE_PX,) * 2), (ADAPTIVE_PX,) * 2)
    wanted = twice - picture if expected else np.zeros_like(picture)
    np.testing.assert_allclose(adaptive(picture), wanted, atol=0.02 * contrast)
