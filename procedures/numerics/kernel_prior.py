"""Size, width and smoothness of a kernel, estimated from its least-squares estimate and the covariance of that.

The prior of a kernel h, observed with errors e of known covariance E, is a Gaussian process of mean 0 and standard
deviation

    sigma(r) = a (1 + (r / R)^2)^(-3/2)

at r from the centre, which falls as the mean far tail of every PSF does. Its correlation is Matern's of order 5/2 with
length L: curves with two derivatives. a, R and L maximise the likelihood of the estimate h + e, of covariance C + E:
smoothness and narrowness are assumed only as far as they show above the noise, and at low noise the prior has almost
no effect.

Source: Rasmussen, Williams, Gaussian Processes for Machine Learning (2006), sections 4.2 and 5.4.1; Gilmour, Thompson,
Cullis, Biometrics 51 (1995) 1440-1450 (average information).
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from procedures.numerics.arrays import Array
from procedures.numerics.normal_equations import inverse_lower

START_PX = (0.2, 0.9, 1.1)
"""a per square pixel of a kernel of sum 1, R and L in pixels: starting values and prior medians."""
START_SPREAD = 1.0
"""Prior standard deviation of their logarithms, which regularises the search where the data are uninformative."""
ROUGHNESS = 1e-4  # uncorrelated fraction of the variance: keeps the smoothest prior invertible
CENTRAL_SIDES = (11, 17)
"""Sides in samples of the central squares used, one after the other: the smaller one takes a tenth of the time and
gives a good start. Samples beyond the larger are faint and would dominate the time."""
MAX_ITERATIONS, MAX_STEP, TOLERANCE = 10, 1.0, 0.05
"""Iterations of the search, its longest step and the step at which it ends, in logarithms: below that the result
changes by less than its noise."""


def prior_covariance(h: Array, errors: Array, s: int) -> Array:
    """Covariance (n, n) of the most likely prior of a kernel, given its estimate.

    h : (n,) the kernel's k x k values row by row, with errors, of a sum near 1
    errors : (n, n) their covariance
    s : samples per pixel
    """
    k = round(len(h) ** 0.5)
    at = start = _start(s)
    for side in CENTRAL_SIDES:
        rim = max(0, (k - side) // 2)
        inner = np.arange(k * k).reshape(k, k)[rim : k - rim, rim : k - rim].ravel()
        at = _most_likely(h[inner], errors[np.ix_(inner, inner)], start, at)
    return _Prior.at(at, k).C


def _start(s: int) -> Array:
    """Prior medians of the logarithms of a, R and L, in samples."""
    a, radius, length = START_PX
    return np.log([a / s**2, radius * s, length * s])


def _most_likely(h: Array, errors: Array, start: Array, at: Array) -> Array:
    """The logarithms of a, R and L, in samples, of the highest posterior; `start` are the prior medians, `at` is where
    the search begins."""
    k = round(len(h) ** 0.5)
    precision = 1 / START_SPREAD**2
    best, pace = -np.inf, 1.0
    step: Array = np.zeros(3)
    for _ in range(MAX_ITERATIONS):
        likelihood, score, information = _likelihood(_Prior.at(at + step, k), h, errors)
        away = at + step - start
        likelihood -= float(precision * away @ away) / 2
        if likelihood < best:
            step, pace = step / 2, pace / 2  # the average information is only approximate: the step was too long
        else:
            at, best = at + step, likelihood
            step = np.asarray(np.linalg.solve(information + precision * np.eye(3), score - precision * away))
            step = step * min(pace, MAX_STEP / np.abs(step).max())
        if np.abs(step).max() < TOLERANCE:
            break
    return at


@dataclass(frozen=True)
class _Prior:
    """The covariance C of a prior, and its derivatives by the logarithms of a, R and L: 2 C; wide_i C_ij + C_ij wide_j;
    `lengthened` (n, n)."""

    C: Array
    wide: Array
    lengthened: Array

    @classmethod
    def at(cls, logarithms: Array, k: int) -> "_Prior":
        """The prior at the logarithms of a, R and L in samples."""
        a, radius, length = np.exp(logarithms)
        half = np.arange(k) - k // 2
        r2 = (half[:, None] ** 2 + half**2).ravel() / radius**2
        sigma = a * (1 + r2) ** -1.5
        x = np.sqrt(5) / length * np.hypot(np.arange(k)[:, None], np.arange(k))
        decay = np.exp(-x)
        alike = (1 - ROUGHNESS) * (1 + x + x * x / 3) * decay
        alike[0, 0] = 1.0
        lags = _lags(k)
        scale = sigma[:, None] * sigma
        lengthened = (1 - ROUGHNESS) * x * x * (1 + x) / 3 * decay
        return cls(scale * alike.ravel()[lags], 3 * r2 / (1 + r2), scale * lengthened.ravel()[lags])

    def changes(self, v: Array) -> Array:
        """The three derivatives of C times v (n,): (n, 3)."""
        Cv = self.C @ v
        return np.column_stack([2 * Cv, self.wide * Cv + self.C @ (self.wide * v), self.lengthened @ v])

    def traces(self, M: Array) -> Array:
        """The traces of the symmetric M (n, n) times the three derivatives of C."""
        shares = np.einsum("ij,ij->i", M, self.C)
        return np.array([2 * shares.sum(), 2 * self.wide @ shares, np.einsum("ij,ij->", M, self.lengthened)])


@lru_cache(maxsize=4)
def _lags(k: int) -> npt.NDArray[np.intp]:
    """Index of the lag between two of the k x k values in a table of k x k lags: (k^2, k^2)."""
    apart = np.abs(np.subtract.outer(np.arange(k), np.arange(k)))
    return (k * apart[:, None, :, None] + apart[None, :, None, :]).reshape(k * k, k * k)


def _likelihood(prior: _Prior, h: Array, errors: Array) -> tuple[float, Array, Array]:
    """Log likelihood of the estimate, its gradient (3,) and the average information (3, 3)."""
    inverse_factor = inverse_lower(np.linalg.cholesky(prior.C + errors))
    inverse = inverse_factor.T @ inverse_factor
    weighted = inverse @ h
    changes = prior.changes(weighted)
    likelihood = float(np.log(np.diag(inverse_factor)).sum() - h @ weighted / 2)
    score = (weighted @ changes - prior.traces(inverse)) / 2
    return likelihood, score, changes.T @ inverse @ changes / 2
