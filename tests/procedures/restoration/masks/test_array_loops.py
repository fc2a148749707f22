"""Loops over arrays compared with NumPy and SciPy, to rounding."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from procedures.restoration.masks.array_loops import advance, gaussian, turn


@pytest.mark.parametrize("sigma", [0.7, 4.0, 30.0])  # the last reaches beyond the frame from everywhere
def test_a_window_of_gaussian_weight(rng, sigma):
    a = rng.standard_normal((23, 31))
    np.testing.assert_allclose(
        gaussian(a, sigma, 3.5), gaussian_filter(a, sigma, truncate=3.5, mode="nearest"), atol=1e-14
    )


def test_conjugate_gradients_move_in_place(rng):
    x, r, p, q = rng.standard_normal((4, 3, 101, 97))
    x_expected, r_expected, p_expected = x + 0.3 * p, r - 0.3 * q, -0.7 * p + q
    advance(x, r, p, q, 0.3)
    turn(p, q, -0.7)
    for result, expected in ((x, x_expected), (r, r_expected), (p, p_expected)):
        np.testing.assert_allclose(result, expected, atol=1e-14)
