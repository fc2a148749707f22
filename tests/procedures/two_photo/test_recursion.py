"""The recursion for OTFs with a kernel in closed form."""

from collections.abc import Callable

import numpy as np
import pytest

from procedures.numerics.kernel_tail import tail_sums
from procedures.psf import Psf, PsfTail
from procedures.two_photo.recursion import TAIL, Recovered, gain_of, otf_by_recursion, psf_by_equation, psf_by_recursion

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
    """Inter-image kernel of a Gaussian PSF: a Gaussian of the difference of both variances."""
    inverse = np.linalg.inv(J)
    return without_tail(gaussian(variance - inverse @ variance @ inverse.T))


def without_tail(kernel: np.ndarray) -> np.ndarray:
    """The samples, and no tail."""
    return np.append(kernel.ravel(), np.zeros(TAIL))


@BOTH
@pytest.mark.parametrize("J", [ROLLED, ZOOMED], ids=["rolled", "anisotropic"])
def test_gaussians_are_recovered(recover: Recover, J: np.ndarray) -> None:
    h = recover(between(VARIANCE, J), S, J).h
    # 1e-3 of these Gaussians lies outside band and support
    assert np.linalg.norm(h - gaussian(VARIANCE)) < 3e-3 * np.linalg.norm(h)


@BOTH
def test_derivative_is_that_of_the_result(recover: Recover, rng: np.random.Generator) -> None:
    kernel = 1.1 * between(VARIANCE, ZOOMED)
    step = 1e-6 * rng.standard_normal(K * K + TAIL)
    change = (recover(kernel + step, S, ZOOMED).parameters - recover(kernel - step, S, ZOOMED).parameters) / 2
    predicted = recover(kernel, S, ZOOMED).derivative @ step
    # the equation's derivative neglects the change of its small residual
    assert np.linalg.norm(change - predicted) < 5e-3 * np.linalg.norm(change)


@BOTH
def test_the_sum_is_the_gain(recover: Recover) -> None:
    kernel = between(VARIANCE, ZOOMED)
    assert gain_of(recover(1.2 * kernel, S, ZOOMED).parameters) == pytest.approx(1.2, abs=1e-6)
    np.testing.assert_allclose(
        recover(1.2 * kernel, S, ZOOMED).h, 1.2 * recover(kernel, S, ZOOMED).h, rtol=0, atol=1e-9
    )


def with_tail(slope: float) -> np.ndarray:
    """A kernel of two pixels' width, and a tail with an excess close to the support and one along the diagonals."""
    kernel = gaussian(VARIANCE)
    tail = slope * np.array([0.04, 0.008, 0.002, 0.0, -0.003, 0.0])
    total = np.append(kernel.ravel(), tail)
    return total / gain_of(total)


@pytest.mark.parametrize("J", [ROLLED, ZOOMED], ids=["rolled", "anisotropic"])
def test_the_psf_has_the_recursion_s_own_otf(J: np.ndarray) -> None:
    total = with_tail(1.0)
    h, k = psf_by_recursion(total, S, J), K * K
    psf = Psf(h.h / h.h.sum(), S, np.eye(k), PsfTail(h.parameters[k:] / h.h.sum(), np.eye(TAIL), np.zeros((k, TAIL))))
    f = np.linspace(0.01, 0.6, 25)
    for x, y in ((1, 0), (0, 1), (0.7, 0.7), (0.8, -0.6)):
        truth, _ = otf_by_recursion(total, S, J, x * f, y * f)
        # a product of scaled shapes differs from a sum of shapes by less than a thousandth
        np.testing.assert_allclose(psf.spectra(x * f, y * f) @ psf.parameters / psf.light, truth, rtol=0, atol=1e-3)


def test_a_mean_tail_includes_that_of_the_near_photograph() -> None:
    # h = k * (k scaled by 1 / lambda) * ...: the far tails add, a (1 + 1/lambda + 1/lambda^2 ...)
    kernel = np.append(gaussian(VARIANCE).ravel(), [0.04, *np.zeros(TAIL - 1)])
    kernel /= gain_of(kernel)
    p = psf_by_recursion(kernel, S, 4.0 * np.eye(2)).parameters
    assert p[K * K] / kernel[K * K] == pytest.approx(1 / (1 - 1 / 4), rel=0.02)


@pytest.mark.slow
def test_an_infinite_tail_is_recovered() -> None:
    # (1 + (r/a)^2)^(-3/2) has the OTF exp(-2 pi a f) and the tail 1/r^3; the kernel is the same with 3/4 of a
    a, zoom = 0.15, 4.0
    f = (np.arange(-64, 64) + 0.5) / 128 * S
    fx, fy = (axis.ravel() for axis in np.meshgrid(f, f))
    waves = spectra(fx, fy)
    # truncation at the band's edge rings outside the support; low frequencies matter
    weight = 1 / np.hypot(fx, fy)
    waves_w, light = waves * weight[:, None], np.concatenate([np.ones(K * K), tail_sums(K)])
    kernel_otf = np.exp(-2 * np.pi * 0.75 * a * np.hypot(fx, fy))
    system = np.vstack([waves_w.real, 1e4 * light])
    kernel = np.linalg.lstsq(system, np.append(weight * kernel_otf, 1e4), rcond=None)[0]
    p = psf_by_recursion(kernel, S, zoom * np.eye(2)).parameters
    at = np.array([0.05, 0.1, 0.2, 0.4])
    value = spectra(at, 0 * at) @ p / gain_of(p)
    np.testing.assert_allclose(value, np.exp(-2 * np.pi * a * at), rtol=0, atol=4e-3)


def spectra(fx: np.ndarray, fy: np.ndarray) -> np.ndarray:
    """Spectra of unit samples and amplitudes."""
    empty = PsfTail(np.zeros(TAIL), np.zeros((TAIL, TAIL)), np.zeros((K * K, TAIL)))
    return Psf(np.eye(K), S, np.eye(K * K), empty).spectra(fx, fy)


@pytest.mark.slow
def test_covariance_is_that_of_many_draws(rng: np.random.Generator) -> None:
    kernel, sigma = with_tail(1.0), 1e-4
    draws = [
        psf_by_recursion(kernel + sigma * rng.standard_normal(K * K + TAIL), S, ZOOMED).parameters for _ in range(20)
    ]
    expected = psf_by_recursion(kernel, S, ZOOMED).covariance(sigma**2 * np.eye(K * K + TAIL))
    # 20 draws of 175 parameters: their mean variance is known to 2.5 %
    assert np.var(draws, axis=0, ddof=1).mean() == pytest.approx(np.trace(expected) / len(expected), rel=0.08)


@BOTH
def test_a_map_that_does_not_enlarge_is_refused(recover: Recover) -> None:
    with pytest.raises(ValueError, match="near photograph must be larger"):
        recover(without_tail(gaussian(VARIANCE)), S, np.diag([4.0, 0.9]))
