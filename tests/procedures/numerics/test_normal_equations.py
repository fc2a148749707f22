import numpy as np
import pytest

from procedures.numerics.normal_equations import eliminate, gram, normalised, products, products_within

pytestmark = pytest.mark.delicate


def test_elimination_equals_the_whole_problem_for_every_right_hand_side(rng):
    A, Z = rng.standard_normal((200, 12)).astype(np.float32), rng.standard_normal((200, 4))
    r = rng.standard_normal(200)
    whole = np.linalg.lstsq(np.hstack([A, Z]), r, rcond=None)[0]
    equations = eliminate(products(gram(A), A, Z, r))
    h = np.linalg.solve(equations.G, equations.b)
    np.testing.assert_allclose(h, whole[:12], atol=2e-6)  # products in float32
    np.testing.assert_allclose(equations.nuisance(h), whole[12:], atol=2e-6)
    change = rng.standard_normal(12)
    moved = equations.nuisance(h + change) - equations.nuisance(h)
    np.testing.assert_allclose(equations.response(change), moved, atol=1e-12)
    covariance = np.linalg.inv(np.hstack([A, Z]).T @ np.hstack([A, Z]))[:12, :12]
    np.testing.assert_allclose(np.linalg.inv(equations.G), covariance, atol=1e-7)
    A, Z = rng.standard_normal((200, 12)).astype(np.float32), rng.standard_normal((200, 4))
    r, other = rng.standard_normal((2, 200))
    whole = np.hstack([A, np.empty((200, 5), np.float32)])
    parts = products_within(whole, 12, Z, r).with_right_side(A, Z, other)
    equations = eliminate(products_within(whole, 12, Z, r)).with_right_side(parts)
    expected = np.linalg.lstsq(np.hstack([A, Z]), other, rcond=None)[0]
    np.testing.assert_allclose(equations.kernel, expected[:12], atol=2e-6)  # products in float32
    np.testing.assert_allclose(equations.nuisance(equations.kernel), expected[12:], atol=2e-6)
    np.testing.assert_allclose(equations.inverse, np.linalg.inv(equations.G), atol=1e-12)
    # single precision of A'A, times the condition of the inverted matrix
    np.testing.assert_allclose(equations.inverse_where_known @ (A.T @ A), np.eye(A.shape[1]), atol=1e-5)


def test_priors_are_further_rows_and_joined_columns_are_the_kernels(rng: np.random.Generator) -> None:
    A, Z = rng.standard_normal((200, 12)).astype(np.float32), rng.standard_normal((200, 5))
    r, precision, pull = rng.standard_normal(200), np.array([0.0, 40.0, 300.0]), np.array([3.0, 2.0, -1.0])
    rows = np.hstack([np.zeros((3, 14)), np.diag(np.sqrt(precision))])
    whole, right = np.vstack([np.hstack([A, Z]), rows]), np.append(r, np.sqrt(precision) * pull)
    expected = np.linalg.lstsq(whole, right, rcond=None)[0]
    parts, last = products(gram(A), A, Z, r), np.r_[0, 0, 1, 1, 1] == 1
    every, of_all = np.zeros((2, 5))
    every[last], of_all[last] = precision, pull
    prior = parts.with_prior(every, of_all)
    for one in (prior, prior.with_right_side(A, Z, r)):
        equations = eliminate(one)
        solution = [*equations.kernel, *equations.nuisance(equations.kernel)]
        np.testing.assert_allclose(solution, expected, atol=2e-6)  # products in float32
    joined = eliminate(parts.with_joined(4, precision, pull))
    h = joined.kernel
    np.testing.assert_allclose([*h[:12], *joined.nuisance(h), *h[12:]], expected, atol=2e-6)


def test_normalised_covariance_has_no_error_of_the_sum(rng: np.random.Generator) -> None:
    h, root = rng.random(9) + 0.2, rng.standard_normal((9, 9)) * 1e-3
    unit, covariance = normalised(h, root @ root.T)
    assert unit.sum() == pytest.approx(1)
    assert np.abs(covariance.sum(axis=0)).max() < 1e-12
    draws = np.array([normalised(h + root @ rng.standard_normal(9), root)[0] for _ in range(4000)])
    np.testing.assert_allclose(np.cov(draws.T), covariance, atol=0.1 * np.abs(covariance).max())
