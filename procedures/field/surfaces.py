"""Vectors measured at places of the frame, as smooth surfaces with their error: what is not the PSF itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.numerics.scattered import Polynomial, monomials

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Surface:
    """A polynomial in each component of a vector that was measured with known errors.

    Attributes
    ----------
    smoother : Polynomial
    values : (N, m) float64, covariances : (N, m, m) float64
        As measured, and of their noise.
    lack : (m,) float64
        Variance of what the polynomial leaves out, from place to place, as much as the values do not exclude.
    """

    smoother: Polynomial
    values: Array
    covariances: Array
    lack: Array

    @property
    def degree(self) -> int:
        """Of the polynomial."""
        return self.smoother.degree

    def at(self, points: Array) -> Array:
        """Values (n, m) at points (n, 2)."""
        return np.asarray(self.smoother.weights(points) @ self.values)

    def covariance(self, points: Array) -> Array:
        """Covariances (n, m, m) at points (n, 2): noise, and what the polynomial leaves out."""
        w = self.smoother.weights(points)
        noise = np.einsum("ni,iab->nab", w**2, self.covariances)
        return np.asarray(noise + (1 + np.sum(w**2, axis=1))[:, None, None] * np.diag(self.lack))

    def solution(self) -> Array:
        """What gives the polynomial's coefficients from the values, (c, N); coefficients as `monomials` orders them."""
        places, degree = self.smoother.places, self.degree
        # weights at the places are D S, S the solution's matrix: D has full rank
        return np.asarray(np.linalg.lstsq(monomials(places, degree), self.smoother.weights(places), rcond=None)[0])

    def coefficients(self) -> tuple[Array, Array]:
        """The polynomial's coefficients (c, m), as `monomials` orders them, and the covariance (m, c, c) of each."""
        S = self.solution()
        variance = np.diagonal(self.covariances, axis1=1, axis2=2) + self.lack
        return S @ self.values, np.einsum("ci,im,di->mcd", S, variance, S)


def fit_surface(places: Array, values: Array, covariances: Array, degrees: Sequence[int]) -> Surface:
    """The surface of the degree that predicts places left out best.

    Parameters
    ----------
    places : (N, 2), values : (N, m), covariances : (N, m, m)
    degrees : sequence of int
        That are tried, as far as the places determine them.

    Raises
    ------
    ValueError
        If the places do not determine the lowest.
    """
    noise = np.trace(covariances, axis1=1, axis2=2)
    trust = noise.mean() / noise if np.all(noise > 0) else np.ones(len(places))
    fits = [(trust @ np.sum(left**2, axis=1), degree, left, share) for degree, left, share in _tried(
        places, values, trust, degrees)]  # fmt: skip
    if not fits:
        raise ValueError(f"{len(places)} places do not determine a surface of degree {min(degrees)}")
    _, degree, left, share = min(fits, key=lambda one: float(one[0]))
    variance = np.diagonal(covariances, axis1=1, axis2=2)
    excess = (left**2 - variance - share[:, None] * variance.mean(axis=0)) / (1 + share)[:, None]
    # one standard error more than the mean: what the places left out do not exclude
    lack = excess.mean(axis=0) + excess.std(axis=0, ddof=1) / np.sqrt(len(excess))
    return Surface(Polynomial(places, trust, degree), values, covariances, np.maximum(lack, 0.0))


def _tried(
    places: Array, values: Array, trust: Array, degrees: Sequence[int]
) -> list[tuple[int, Array, Array]]:  # fmt: skip
    """Of every degree that is determined: the errors (N, m) at places left out, and the others' share (N,) in them."""
    found = []
    for degree in degrees:
        left, share = np.zeros_like(values), np.zeros(len(places))
        try:
            for i in range(len(places)):
                kept = np.arange(len(places)) != i
                w = Polynomial(places[kept], trust[kept], degree).weights(places[i : i + 1])[0]
                left[i], share[i] = values[i] - w @ values[kept], w @ w
        except ValueError:
            continue
        found.append((degree, left, share))
    return found
