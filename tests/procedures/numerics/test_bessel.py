"""Bessel functions compared with SciPy's, computed by other methods."""

import numpy as np
import scipy.special
from scipy.integrate import quad

from procedures.numerics.transforms import integral_of_j0, j0, j1

X = np.concatenate([[0.0, 1e-9], np.linspace(-30, 30, 301), [123.4, 1000.7]])


def test_j0_j1_and_the_integral_of_j0_agree_with_scipy():
    np.testing.assert_allclose(j0(X), scipy.special.j0(X), atol=2e-14)
    np.testing.assert_allclose(j1(X), scipy.special.j1(X), atol=2e-14)
    assert j0(0.0) == 1
    # not scipy.special.itj0y0, which before SciPy 1.17 is wrong beyond 20
    x = X[X > 0][::3]
    integrals = [quad(scipy.special.j0, 0, one, limit=400, epsabs=1e-11)[0] for one in x]
    np.testing.assert_allclose(integral_of_j0(x), integrals, atol=1e-9)
    h = 1e-4
    slope = (integral_of_j0(X + h) - integral_of_j0(X - h)) / (2 * h)
    np.testing.assert_allclose(slope, j0(X), atol=1e-8)  # h^2 / 6 times the third derivative, and rounding over h


def test_shape_is_kept_and_blocks_join(monkeypatch):
    monkeypatch.setattr("procedures.numerics.transforms.LARGEST_BLOCK", 500)
    grid = np.linspace(0, 20, 60).reshape(5, 12)
    np.testing.assert_allclose(j1(grid), scipy.special.j1(grid), atol=2e-14)
