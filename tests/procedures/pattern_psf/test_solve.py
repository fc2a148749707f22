from __future__ import annotations

import numpy as np
import pytest
import scipy.signal

from procedures.outcome import BadParameter
from procedures.pattern_psf.solve import (
    convolve_at,
    eliminate,
    gamma,
    gamma_bound,
    gram,
    normalised,
    products,
    sample_convolution,
    solve,
)

S, K, ROWS, COLUMNS = 3, 5, 20, 24


@pytest.fixture
def raster(rng: np.random.Generator) -> np.ndarray:
    return (rng.random((S * (ROWS - 1) + K, S * (COLUMNS - 1) + K)) - 0.5).astype(np.float32)


@pytest.fixture
def pixels() -> tuple[np.ndarray, np.ndarray]:
    rows, columns = np.mgrid[:ROWS, :COLUMNS]
    return rows.ravel().astype(np.int64), columns.ravel().astype(np.int64)


def test_matrix_is_convolution_then_sampling(raster, pixels, rng) -> None:
    h = rng.random((K, K)).astype(np.float32)
    weight = np.full(ROWS * COLUMNS, 2.0, np.float32)
    expected = scipy.signal.convolve2d(raster, h, mode="valid")[::S, ::S].ravel()
    A = sample_convolution(raster, *pixels, weight, S, K)
    np.testing.assert_allclose(A @ h.ravel(), 2 * expected, rtol=0, atol=1e-5)  # float32 sums of 25
    np.testing.assert_allclose(convolve_at(raster, *pixels, h, S), expected, rtol=0, atol=1e-5)


def test_elimination_equals_the_whole_least_squares_problem(rng: np.random.Generator) -> None:
    A, Z = rng.standard_normal((200, 12)).astype(np.float32), rng.standard_normal((200, 4))
    r = rng.standard_normal(200)
    whole = np.linalg.lstsq(np.hstack([A, Z]), r, rcond=None)[0]
    equations = eliminate(products(gram(A), A, Z, r))
    h = solve(equations.G, equations.b, "ls")
    np.testing.assert_allclose(h, whole[:12], atol=2e-6)  # products in float32
    np.testing.assert_allclose(equations.nuisance(h), whole[12:], atol=2e-6)
    covariance = np.linalg.inv(np.hstack([A, Z]).T @ np.hstack([A, Z]))[:12, :12]
    np.testing.assert_allclose(np.linalg.inv(equations.G), covariance, atol=1e-7)


def test_solvers_differ_only_in_what_is_negative(rng: np.random.Generator) -> None:
    A = rng.standard_normal((300, 20))
    truth = np.maximum(rng.standard_normal(20), 0)
    G, b = A.T @ A, A.T @ (A @ truth + 0.3 * rng.standard_normal(300))
    free, clipped, positive = (solve(G, b, name) for name in ("ls", "clip", "nnls"))
    assert (clipped == np.maximum(free, 0)).all()
    assert (positive >= 0).all()
    # the constraint is true: it can only help
    assert np.linalg.norm(positive - truth) < np.linalg.norm(free - truth)


def test_unknown_solver_is_refused() -> None:
    with pytest.raises(BadParameter, match="ls, clip, nnls; got 'svd'"):
        solve(np.eye(2), np.ones(2), "svd")


def test_gamma_of_random_noise_is_close_over_its_bound(rng: np.random.Generator) -> None:
    # thesis, section 2.3.2: Bernoulli noise all but reaches Proposition 1
    m, n = 6000, 49
    A = rng.integers(0, 2, (m, n)).astype(np.float64)
    amplification = gamma(np.linalg.inv(A.T @ A), 1.0)
    assert gamma_bound(m, n) < amplification < 1.03 * gamma_bound(m, n)


def test_error_stays_under_gamma(rng: np.random.Generator) -> None:
    A = rng.integers(0, 2, (2000, 25)).astype(np.float64)
    G = A.T @ A
    sigma = 0.02
    errors = [np.linalg.norm(np.linalg.solve(G, A.T @ (sigma * rng.standard_normal(2000)))) for _ in range(200)]
    # the mean square error is gamma^2 sigma^2, here from 200 draws of some 25 freedoms: 2 %
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(gamma(np.linalg.inv(G), 1.0) * sigma, rel=0.08)


def test_normalised_covariance_has_no_error_of_the_sum(rng: np.random.Generator) -> None:
    h, root = rng.random(9) + 0.2, rng.standard_normal((9, 9)) * 1e-3
    unit, covariance = normalised(h, root @ root.T)
    assert unit.sum() == pytest.approx(1)
    assert np.abs(covariance.sum(axis=0)).max() < 1e-12
    draws = np.array([normalised(h + root @ rng.standard_normal(9), root)[0] for _ in range(4000)])
    np.testing.assert_allclose(np.cov(draws.T), covariance, atol=0.1 * np.abs(covariance).max())
