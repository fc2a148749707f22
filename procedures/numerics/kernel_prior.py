"""How large, how wide and how smooth a kernel is, told by its own least-squares estimate and the noise of that.

A kernel h seen with errors e of known covariance E is drawn, before anything is known of its form, from a Gaussian
process: of mean 0, of standard deviation

    sigma(r) = a (1 + (r / R)^2)^(-3/2)

at r from the centre, which falls as the mean far tail of every PSF does, and of neighbours that are alike over a length
L (Matern's correlation of order 5/2: curves that have two derivatives and need no more). The three numbers are those
under which the estimate h + e, of covariance C + E, is most likely: nothing is taken for smooth or narrow that is not
seen to be so above the noise, and where the noise is low the prior is no more than a formality.

References
----------
Rasmussen, Williams, Gaussian Processes for Machine Learning (2006), sections 4.2 and 5.4.1; Gilmour, Thompson, Cullis,
Biometrics 51 (1995) 1440-1450 (average information).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from procedures.numerics.triangular import inverse_lower

Array = npt.NDArray[np.float64]

START_PX = (0.2, 0.9, 1.1)
"""a per square pixel of a kernel of sum 1, R and L in pixels: where the search begins."""
START_SPREAD = 1.0
"""Standard deviation of their logarithms about that: what the search is held by where the data say nothing."""
ROUGHNESS = 1e-4
"""Share of the variance that no neighbour knows of: keeps the smoothest prior a matrix that can be inverted."""
MIDDLES = (11, 17)
"""Samples along the side of the squares that tell them, one after the other: the smaller one takes a tenth of the time
and brings the search near. What lies beyond the larger is faint and would take most of the time."""
STEPS, LONGEST, STILL = 10, 1.0, 0.05
"""Steps of the search, the longest one and the one at which it ends, in logarithms: the answer changes by less than
its noise."""


def prior_covariance(h: Array, errors: Array, s: int) -> Array:
    """Covariance (n, n) of the most likely prior of a kernel, given its estimate.

    Parameters
    ----------
    h : (n,) float64
        The kernel's k x k values row by row, of a sum near 1, with errors.
    errors : (n, n) float64
        Their covariance.
    s : int
        Samples per pixel.
    """
    k = round(len(h) ** 0.5)
    at = start = _start(s)
    for side in MIDDLES:
        at = _most_likely(*_middle(h, errors, k, side), start, at)
    return _Prior.at(at, k).C


def _start(s: int) -> Array:
    """The logarithms of a, R and L, in samples, that are expected."""
    a, radius, length = START_PX
    return np.log([a / s**2, radius * s, length * s])


def _middle(h: Array, errors: Array, k: int, side: int) -> tuple[Array, Array]:
    """The estimate's central side x side values at most, and their errors' covariance."""
    rim = max(0, (k - side) // 2)
    inner = np.arange(k * k).reshape(k, k)[rim : k - rim, rim : k - rim].ravel()
    return h[inner], errors[np.ix_(inner, inner)]


def _most_likely(h: Array, errors: Array, start: Array, at: Array) -> Array:
    """The logarithms of a, R and L, in samples, under which the estimate is most likely; `start` is what they are
    expected to be, `at` where the search begins."""
    k = round(len(h) ** 0.5)
    held = 1 / START_SPREAD**2
    best, pace = -np.inf, 1.0
    step: Array = np.zeros(3)
    for _ in range(STEPS):
        likelihood, score, information = _likelihood(_Prior.at(at + step, k), h, errors)
        away = at + step - start
        likelihood -= float(held * away @ away) / 2
        if likelihood < best:
            step, pace = step / 2, pace / 2  # the information is an average: where it is too small, steps are too long
        else:
            at, best = at + step, likelihood
            step = np.asarray(np.linalg.solve(information + held * np.eye(3), score - held * away), dtype=np.float64)
            step = step * min(pace, LONGEST / np.abs(step).max())
        if np.abs(step).max() < STILL:
            break
    return at


@dataclass(frozen=True)
class _Prior:
    """The covariance C (n, n) of a prior, and what changes it with the logarithms of a, R and L.

    By the first it is 2 C; by the second it is wide_i C_ij + C_ij wide_j; by the third it is `lengthened` (n, n).
    """

    C: Array
    wide: Array
    lengthened: Array

    @classmethod
    def at(cls, logarithms: Array, k: int) -> _Prior:
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
    """Where the lag between two of the k x k values stands in a table of k x k lags: (k^2, k^2)."""
    apart = np.abs(np.subtract.outer(np.arange(k), np.arange(k)))
    return (k * apart[:, None, :, None] + apart[None, :, None, :]).reshape(k * k, k * k)


def _likelihood(prior: _Prior, h: Array, errors: Array) -> tuple[float, Array, Array]:
    """Logarithm of the probability of the estimate, its slope (3,) and the average information (3, 3)."""
    inverse_factor = inverse_lower(np.linalg.cholesky(prior.C + errors))
    inverse = inverse_factor.T @ inverse_factor
    weighted = inverse @ h
    changes = prior.changes(weighted)
    likelihood = float(np.log(np.diag(inverse_factor)).sum() - h @ weighted / 2)
    score = (weighted @ changes - prior.traces(inverse)) / 2
    return likelihood, score, changes.T @ inverse @ changes / 2
