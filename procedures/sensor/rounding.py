"""Effect of rounding on the statistics of noisy numbers, and its inversion where noise is less than a digital number.

A pixel of mean x and temporal noise sigma gives round(x + sigma n). By Fourier's series of the rounding error, its mean
is

    g(x) = x + sum_k a_k sin(2 pi k x),    a_k = (-1)^k / (pi k) exp(-2 pi^2 k^2 sigma^2)

Over pixels of means x ~ N(m, s^2), with e_k(v) = exp(-2 pi^2 k^2 v), C_k = cos(2 pi k m) and S_k = sin(2 pi k m),

    mean        M = m + B,    B = sum_k a_k e_k(s^2) S_k
    spatial     V_s = s^2 + 2 s^2 sum_k 2 pi k a_k e_k(s^2) C_k + E[(g - x)^2] - B^2
    temporal    V_t = t^2 + 1/12 + sum_k (-1)^k e_k(t^2) C_k (1 / (pi k)^2 + 4 t^2) - B^2 - V_s,    t^2 = s^2 + sigma^2

Above `NEGLIGIBLE` the sums vanish and V_t = sigma^2 + 1/12, as EMVA 1288 has it.
"""

from dataclasses import dataclass

import numpy as np

from procedures.numerics.arrays import Array

NEGLIGIBLE = 0.5  # temporal variance, in squared digital numbers, above which rounding adds 1/12 to 1e-3
HARMONICS = 9
LEAST, MOST = 0.05, 1.0
"""Standard deviations of temporal noise and of pixels that are distinguished: less is like the first."""
ITERATIONS, ENOUGH = 24, 8
SMALL_FALL, FEW = 1e-2, 0.02
"""Fall of the sum of squares below which a draw is at its minimum; share of the draws that may not be."""
WRONG = 9.0
"""Sum of squares of the weighted residuals above which a draw lies in a local minimum and is replaced by another."""
CHANGE = 1e-4  # change of the parameters by which derivatives are taken
SUBTRACTIONS = 10
LARGEST_STEP = 0.5  # greatest change of a parameter in one iteration: digital numbers, or logarithm
UNDETERMINED, BINS = 0.05, 20
"""Relative scatter of the temporal noise, or of the pixels, from which all possible values count alike, and their
classes."""
SCATTER = 0.1  # standard deviation of the temporal variance from pixel to pixel where rounding dominates
LEAST_UNCERTAINTY = 1e-4
"""Least standard uncertainty of the statistics: noise and pixels are not exactly normally distributed."""


@dataclass(frozen=True, eq=False)
class Unrounded:
    """Statistics before rounding, (1 + draws,): the estimate, and draws consistent with what was measured.

    mean, temporal, spatial : mean, temporal variance and variance of the pixels' means; slope : mean slope of the
    pixels' rounded means over their true ones.
    """

    mean: Array
    temporal: Array
    spatial: Array
    slope: Array


def rounded(mean: Array, sigma: Array, pixels: Array) -> tuple[Array, Array, Array, Array]:
    """Mean, temporal variance, spatial variance and slope after rounding, (n,) each.

    mean, sigma, pixels : (n,) mean, standard deviation of the temporal noise, and of the pixels' means, in digital
    numbers.
    """
    k = np.arange(1, HARMONICS + 1)
    both = np.arange(2 * HARMONICS + 1)[:, None]  # sums and differences of two harmonics
    waves = np.exp(2j * np.pi * both * mean - 2 * np.pi**2 * both**2 * pixels**2)
    C, S = waves.real, waves.imag[k]
    damped = np.exp(-2 * np.pi**2 * k[:, None] ** 2 * sigma**2)
    sign, wave = (-1.0) ** k[:, None], np.pi * k[:, None]
    a = sign / wave * damped
    B = np.sum(a * S, axis=0)
    products = (C[np.abs(k[:, None] - k)] - C[k[:, None] + k]) / 2
    slope = 1 + np.sum(2 * wave * a * C[k], axis=0)
    spatial = pixels**2 * (2 * slope - 1) + np.einsum("kn,ln,kln->n", a, a, products) - B**2
    t2 = sigma**2 + pixels**2
    whole = t2 + 1 / 12 + np.sum(sign * damped * C[k] * (1 / wave**2 + 4 * t2), axis=0) - B**2
    return mean + B, whole - spatial, spatial, slope


def unrounded(measured: Array, variances: Array, rng: np.random.Generator) -> Unrounded:
    """Statistics before rounding from those after it.

    Each draw starts from another prior sample and is fitted to its own draw of the statistics with the prior: where
    these determine a parameter the draws have its uncertainty, elsewhere that of all values which are possible.

    measured : (3, 1 + draws) mean, temporal and spatial variance of the rounded numbers: the estimate, then draws with
        their uncertainties
    variances : (3,) squares of the standard uncertainties; infinite where the spatial variance is not known
    """
    mean, temporal, spatial = measured
    if temporal[0] > NEGLIGIBLE:
        return Unrounded(mean, temporal, spatial, np.ones_like(mean))
    prior = np.array([np.zeros_like(mean), np.full_like(mean, np.log(0.3)), np.full_like(mean, np.log(0.3))])
    low, high = np.log(LEAST), np.log(MOST)
    prior[:, 1:] = rng.uniform([-0.5, low, low], [0.5, high, high], (len(mean) - 1, 3)).T
    prior[0] += mean
    spread = np.array([2.0, 3.0, 3.0])
    fit = _Fit(measured, np.maximum(variances, LEAST_UNCERTAINTY**2), prior, spread)
    m, sigma, s = _levelled(fit.parameters(), rng)
    return Unrounded(m, sigma**2 + 1 / 12, s**2, rounded(m, sigma, s)[3])


def subtracted(mean: Array, temporal: Array, pixels: Array) -> tuple[Array, Array]:
    """Mean and temporal variance before rounding, plus 1/12, of little light on pixels of known deviation, by
    iteration, as photon noise makes the effect small."""
    m, variance = mean, np.maximum(temporal - 1 / 12, LEAST**2)
    for _ in range(SUBTRACTIONS):
        M, V, _spatial, _slope = rounded(m, np.sqrt(variance), pixels)
        m, variance = m + (mean - M) / 2, np.maximum(variance + (temporal - V) / 2, LEAST**2)
    return m, variance + 1 / 12


def finite_pixels(temporal: float, spatial: float, n: int) -> Array:
    """Squared uncertainties (3,) of the statistics where n pixels have few different numbers: no exact normal
    distribution, and another fourth moment than noise."""
    share, spatial = np.exp(-4 * np.pi**2 * max(temporal - 1 / 12, 0.0)), max(spatial, 0.0)
    moment = max(temporal * (1 - 2 * temporal) / 2 - 2 * temporal**2, 0.0)
    return np.array([share * spatial, (share * SCATTER) ** 2 + moment, 2 * (share * spatial) ** 2]) / n


def _levelled(parameters: Array, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Mean, temporal deviation and deviation of the pixels from their logarithms; an undetermined temporal noise has
    all its possible values equally often, and their mean."""
    draws = parameters[:, 1:]
    sigma = np.exp(draws[1])
    if np.std(draws[1:], axis=1).max() > UNDETERMINED:
        edges = np.linspace(sigma.min(), sigma.max(), BINS + 1)[1:-1]
        bins = np.searchsorted(edges, sigma)
        weights = 1 / np.bincount(bins, minlength=BINS)[bins]
        draws = draws[:, rng.choice(len(sigma), len(sigma), p=weights / weights.sum())]
        parameters = np.column_stack([draws.mean(axis=1), draws])
    return parameters[0], np.exp(parameters[1]), np.exp(parameters[2])


class _Fit:
    """Levenberg-Marquardt iteration of all draws at once: residuals of the statistics and departures from the prior."""

    def __init__(self, measured: Array, variances: Array, prior: Array, spread: Array) -> None:
        self._known = np.isfinite(variances)
        self._measured, self._weights = measured[self._known], 1 / variances[self._known]
        self._prior, self._precision = prior, spread**-2

    def parameters(self) -> Array:
        """Mean, and logarithms of the temporal deviation and of that of the pixels: (3, 1 + draws)."""
        p, damping = self._prior.copy(), np.full(self._prior.shape[1], 1e-2)
        best, model = self._sum_of_squares(p)
        for i in range(ITERATIONS):
            J = np.array([(self._model(p + CHANGE * one[:, None]) - model) / CHANGE for one in np.eye(3)])
            normal = np.einsum("pdn,d,qdn->npq", J, self._weights, J) + np.diag(self._precision)
            normal *= 1 + damping[:, None, None] * np.eye(3)
            right = np.einsum("pdn,d,dn->np", J, self._weights, self._measured - model)
            right += (self._precision[:, None] * (self._prior - p)).T
            step = np.linalg.solve(normal, right[..., None])[..., 0].T
            trial = p + np.clip(step, -LARGEST_STEP, LARGEST_STEP)
            trial[1:] = np.clip(trial[1:], np.log(LEAST), np.log(3 * MOST))
            squares, tried = self._sum_of_squares(trial)
            better, falls = squares < best, best - squares > SMALL_FALL
            p, model = np.where(better, trial, p), np.where(better, tried, model)
            best = np.where(better, squares, best)
            damping = np.where(better, damping / 4, np.minimum(damping * 4, 1e6))
            if not np.any(falls) or (i >= ENOUGH and np.mean(falls) < FEW):
                break
        good = np.flatnonzero(self._weights @ (self._measured - model) ** 2 < WRONG)
        return p[:, good[np.arange(p.shape[1]) % len(good)]] if len(good) else p

    def _model(self, p: Array) -> Array:
        return np.array(rounded(p[0], *np.exp(p[1:]))[:3])[self._known]

    def _sum_of_squares(self, p: Array) -> tuple[Array, Array]:
        model = self._model(p)
        departure = self._precision @ (p - self._prior) ** 2
        return self._weights @ (self._measured - model) ** 2 + departure, model
