from __future__ import annotations

import numpy as np
import pytest
import scipy.optimize
from hypothesis import given
from hypothesis import strategies as st

from procedures.numerics.solvers import cholesky_solve, non_negative_least_squares


@given(st.integers(0, 10_000), st.integers(2, 30))
def test_agrees_with_the_active_set_method(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    A, v = rng.standard_normal((2 * n, n)), rng.standard_normal(2 * n)
    x = non_negative_least_squares(A.T @ A, A.T @ v)
    # both are exact up to rounding times the condition of A'A, under 1e4 for such matrices
    np.testing.assert_allclose(x, scipy.optimize.nnls(A, v)[0], atol=1e-9)


def test_solution_meets_the_conditions_of_karush_kuhn_tucker(rng: np.random.Generator) -> None:
    A, v = rng.standard_normal((400, 150)), rng.standard_normal(400)
    G, b = A.T @ A, A.T @ v
    x = non_negative_least_squares(G, b)
    gradient = G @ x - b
    assert (x >= 0).all()
    assert gradient.min() > -1e-9 * np.abs(b).max()
    assert abs(x @ gradient) < 1e-9 * np.abs(b).max()


def test_singular_matrix_is_named() -> None:
    with pytest.raises(np.linalg.LinAlgError):
        cholesky_solve(np.zeros((3, 3)), np.ones(3))
