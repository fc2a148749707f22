"""The recursion against Gaussians, for which kernel and PSF are known in closed form."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from procedures.two_photo.recursion import Recovered, psf_by_equation, psf_by_recursion

S, K = 3, 13
BOTH = pytest.mark.parametrize("recover", [psf_by_recursion, psf_by_equation])
Recover = Callable[[np.ndarray, int, np.ndarray], Recovered]

VARIANCE = np.array([[0.20, 0.05], [0.05, 0.15]])
ROLLED = 4.0 * np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
ZOOMED = np.diag([3.4, 5.1])


def gaussian(variance: np.ndarray) -> np.ndarray:
    x = (np.arange(K) - K // 2) / S
    inverse = np.linalg.inv(variance)
    h = np.exp(-0.5 * (inverse[0, 0] * x**2 + 2 * inverse[0, 1] * x * x[:, None] + inverse[1, 1] * x[:, None] ** 2))
    return h / h.sum()


def between(variance: np.ndarray, J: np.ndarray) -> np.ndarray:
    """The inter-image kernel of a Gaussian PSF: a Gaussian whose variance lacks what the near photograph has."""
    inverse = np.linalg.inv(J)
    return gaussian(variance - inverse @ variance @ inverse.T)


@BOTH
@pytest.mark.parametrize("J", [ROLLED, ZOOMED], ids=["rolled", "anisotropic"])
def test_gaussians_come_back(recover: Recover, J: np.ndarray) -> None:
    h = recover(between(VARIANCE, J), S, J).h
    # samples at 3 per pixel and a support of 4.3 pixels leave 1e-3 of these Gaussians outside
    assert np.linalg.norm(h - gaussian(VARIANCE)) < 3e-3 * np.linalg.norm(h)


@BOTH
def test_derivative_is_that_of_the_result(recover: Recover, rng: np.random.Generator) -> None:
    kernel = 1.1 * between(VARIANCE, ZOOMED)
    step = 1e-6 * rng.standard_normal((K, K))
    change = (recover(kernel + step, S, ZOOMED).h - recover(kernel - step, S, ZOOMED).h) / 2
    predicted = (recover(kernel, S, ZOOMED).derivative @ step.ravel()).reshape(K, K)
    # the equation's derivative leaves out the change of its own small residual
    assert np.linalg.norm(change - predicted) < 5e-3 * np.linalg.norm(change)


@BOTH
def test_sum_is_the_gain(recover: Recover) -> None:
    kernel = between(VARIANCE, ZOOMED)
    assert recover(1.2 * kernel, S, ZOOMED).h.sum() == pytest.approx(1.2, abs=2e-4)  # what lies outside the support
    np.testing.assert_allclose(
        recover(1.2 * kernel, S, ZOOMED).h, 1.2 * recover(kernel, S, ZOOMED).h, rtol=0, atol=1e-9
    )


def test_covariance_is_that_of_many_draws(rng: np.random.Generator) -> None:
    kernel, sigma = between(VARIANCE, ZOOMED), 1e-4
    draws = [psf_by_recursion(kernel + sigma * rng.standard_normal((K, K)), S, ZOOMED).h.ravel() for _ in range(20)]
    expected = psf_by_recursion(kernel, S, ZOOMED).covariance(sigma**2 * np.eye(K * K))
    # 20 draws of 169 samples: their mean variance is known to 2.5 %
    assert np.var(draws, axis=0, ddof=1).mean() == pytest.approx(np.trace(expected) / K**2, rel=0.08)


@BOTH
def test_a_map_that_does_not_enlarge_is_no_pair(recover: Recover) -> None:
    with pytest.raises(ValueError, match="near photograph must be larger"):
        recover(gaussian(VARIANCE), S, np.diag([4.0, 0.9]))
