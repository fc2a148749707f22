"""Loops over arrays compared with NumPy and SciPy, to rounding."""

import numpy as np
import pytest
from scipy.ndimage import laplace

from procedures.restoration.masks import array_loops
from procedures.restoration.masks.array_loops import add_bending, add_diffusion, advance, turn


@pytest.mark.parametrize("threads", [1, 3])
def test_conjugate_gradients_move_in_place(rng, threads, monkeypatch):
    monkeypatch.setattr(array_loops, "most_threads", lambda: threads)
    monkeypatch.setattr(array_loops, "NUMBERS_PER_THREAD", 1)
    x, r, p, q = rng.standard_normal((4, 3, 101, 97))
    # the Laplacian, and its square within the rim, of every band of rows
    out, twice = np.zeros((2, 101, 97))
    add_diffusion(out, x[0])
    add_bending(twice, x[0], 1.0, 1.0, 1.0)
    np.testing.assert_allclose(out, -laplace(x[0], mode="nearest"), atol=1e-13)
    np.testing.assert_allclose(twice[2:-2, 2:-2], laplace(laplace(x[0]))[2:-2, 2:-2], atol=1e-12)
    x_expected, r_expected, p_expected = x + 0.3 * p, r - 0.3 * q, -0.7 * p + q
    advance(x, r, p, q, 0.3)
    turn(p, q, -0.7)
    for result, expected in ((x, x_expected), (r, r_expected), (p, p_expected)):
        np.testing.assert_allclose(result, expected, atol=1e-14)
