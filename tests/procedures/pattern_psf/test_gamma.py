from __future__ import annotations

import numpy as np
import pytest

from procedures.pattern_psf.gamma import gamma, gamma_bound


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
