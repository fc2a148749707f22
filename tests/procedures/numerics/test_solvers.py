import numpy as np
import pytest
import scipy.optimize
from hypothesis import given
from hypothesis import strategies as st

from procedures.numerics.normal_equations import (
    cholesky_inverse,
    cholesky_solve,
    non_negative_least_squares,
    solve_constrained,
)

pytestmark = pytest.mark.delicate


@given(st.integers(0, 10_000), st.integers(2, 30))
def test_agrees_with_the_active_set_method(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    A, v = rng.standard_normal((2 * n, n)), rng.standard_normal(2 * n)
    x = non_negative_least_squares(A.T @ A, A.T @ v)
    # both are exact up to rounding times the condition of A'A, under 1e4 for such matrices
    np.testing.assert_allclose(x, scipy.optimize.nnls(A, v)[0], atol=1e-9)


def test_solutions_meet_the_conditions_of_karush_kuhn_tucker_in_every_case(rng):
    A, v = rng.standard_normal((400, 150)), rng.standard_normal(400)
    G, b = A.T @ A, A.T @ v
    x = non_negative_least_squares(G, b)
    gradient = G @ x - b
    assert (x >= 0).all()
    assert gradient.min() > -1e-9 * np.abs(b).max()
    assert abs(x @ gradient) < 1e-9 * np.abs(b).max()
    G, b = np.array([[15.0, -7, 16], [-7, 9, -13], [16, -13, 23]]), np.array([4.0, -10, 13])
    # x = (0, 0, b / G) meets the conditions: G x - b is (116, 61, 0) / 23
    np.testing.assert_allclose(non_negative_least_squares(G, b), [0, 0, 13 / 23], atol=1e-14)
    assert (non_negative_least_squares(np.eye(2), np.array([-1.0, -2.0])) == 0).all()
    with pytest.raises(np.linalg.LinAlgError):
        cholesky_solve(np.zeros((3, 3)), np.ones(3))
    A = rng.standard_normal((300, 20))
    truth = np.maximum(rng.standard_normal(20), 0)
    G, b = A.T @ A, A.T @ (A @ truth + 0.3 * rng.standard_normal(300))
    free, clipped, positive = (solve_constrained(G, b, name) for name in ("ls", "clip", "nnls"))
    assert (clipped == np.maximum(free, 0)).all()
    assert (positive >= 0).all()
    # the constraint is true: it can only help
    assert np.linalg.norm(positive - truth) < np.linalg.norm(free - truth)
    with pytest.raises(ValueError, match="ls, clip, nnls; got 'svd'"):
        solve_constrained(np.eye(2), np.ones(2), "svd")
    A = rng.standard_normal((60, 25))
    # rounding times a condition under a hundred
    assert np.allclose(cholesky_inverse(A.T @ A) @ (A.T @ A), np.eye(25), atol=1e-11)
