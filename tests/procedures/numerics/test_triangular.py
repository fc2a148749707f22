"""Triangular solvers compared with NumPy's general ones."""

import numpy as np
import pytest
import scipy.fft

from procedures.numerics.normal_equations import BLOCK, inverse_lower, solve_factored, solve_lower
from procedures.numerics.transforms import next_fast_len


@pytest.mark.parametrize("n", [1, 2, BLOCK - 1, BLOCK, BLOCK + 1, 3 * BLOCK + 5])
def test_factors_solve_and_invert_their_product(rng, n):
    A = rng.standard_normal((2 * n, n))
    G, b = A.T @ A + np.eye(n), rng.standard_normal((n, 3))
    L = np.linalg.cholesky(G)
    # rounding grows with the condition, here under 100
    np.testing.assert_allclose(G @ solve_factored(L, b), b, atol=1e-11)
    np.testing.assert_allclose(solve_factored(L, b)[:, 1], solve_factored(L, b[:, 1]), atol=1e-13)
    np.testing.assert_allclose(L @ solve_lower(L, b), b, atol=1e-11)
    inverse = inverse_lower(L)
    np.testing.assert_allclose(L @ inverse, np.eye(n), atol=1e-11)
    assert (np.triu(inverse, 1) == 0).all()


def test_single_precision_stays_single_and_fast_lengths_are_least_products():
    L = np.linalg.cholesky(np.eye(3, dtype=np.float32) * 4)
    assert solve_factored(L, np.ones(3, np.float32)).dtype == np.float32
    lengths = range(1, 3000)
    assert [next_fast_len(n) for n in lengths] == [scipy.fft.next_fast_len(n, real=True) for n in lengths]
