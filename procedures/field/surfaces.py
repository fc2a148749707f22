"""Smooth surfaces through vectors measured at positions of the frame, with their uncertainty."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procedures.numerics.arrays import Array
from procedures.numerics.scattered import Polynomial, monomials


@dataclass(frozen=True, eq=False)
class Surface:
    """A polynomial in each component of a measured vector.

    values : (N, m), covariances : (N, m, m); measured values and covariances of their noise
    lack : (m,), upper estimate of the variance of the model error, per position
    """

    smoother: Polynomial
    values: Array
    covariances: Array
    lack: Array

    @property
    def degree(self) -> int:
        """Degree of the polynomial."""
        return self.smoother.degree

    def at(self, points: Array) -> Array:
        """Values (n, m) at points (n, 2)."""
        return np.asarray(self.smoother.weights(points) @ self.values)

    def covariance(self, points: Array) -> Array:
        """Covariances (n, m, m) at points (n, 2), of noise and model error."""
        w = self.smoother.weights(points)
        noise = np.einsum("ni,iab->nab", w**2, self.covariances)
        return np.asarray(noise + (1 + np.sum(w**2, axis=1))[:, None, None] * np.diag(self.lack))

    def solution(self) -> Array:
        """Matrix (c, N) from the values to the polynomial's coefficients, in the order of `monomials`."""
        places, degree = self.smoother.places, self.degree
        # weights at the places are D S, S the solution's matrix: D has full rank
        return np.asarray(np.linalg.lstsq(monomials(places, degree), self.smoother.weights(places), rcond=None)[0])

    def coefficients(self, combination: Array) -> tuple[Array, Array]:
        """Coefficients (c,) of a linear combination (m,) of the components, in the order of `monomials`, and their
        covariance (c, c)."""
        S, u = self.solution(), combination
        variance = np.einsum("a,iab,b->i", u, self.covariances, u) + u**2 @ self.lack
        return S @ self.values @ u, (S * variance) @ S.T


def fit_surface(places: Array, values: Array, covariances: Array, degrees: Sequence[int]) -> Surface:
    """Surface of the degree with the smallest leave-one-out error.

    Raises ValueError if the places do not determine the lowest.

    places : (N, 2), values : (N, m), covariances : (N, m, m)
    degrees : candidates; those that the places do not determine are skipped
    """
    noise = np.trace(covariances, axis1=1, axis2=2)
    trust = noise.mean() / noise if np.all(noise > 0) else np.ones(len(places))
    fits = []
    for degree in degrees:
        try:
            # errors (N, m) at the excluded places, and the squared weights of the others
            error, share = np.zeros_like(values), np.zeros(len(places))
            for i in range(len(places)):
                kept = np.arange(len(places)) != i
                w = Polynomial(places[kept], trust[kept], degree).weights(places[i : i + 1])[0]
                error[i], share[i] = values[i] - w @ values[kept], w @ w
        except ValueError:
            continue
        fits.append((float(trust @ np.sum(error**2, axis=1)), degree, error, share))
    if not fits:
        raise ValueError(f"{len(places)} places do not determine a surface of degree {min(degrees)}")
    _, degree, error, share = min(fits, key=lambda fit: fit[0])
    variance = np.diagonal(covariances, axis1=1, axis2=2)
    excess = (error**2 - variance - share[:, None] * variance.mean(axis=0)) / (1 + share)[:, None]
    # one standard error above the mean: not excluded by the errors
    lack = excess.mean(axis=0) + excess.std(axis=0, ddof=1) / np.sqrt(len(excess))
    return Surface(Polynomial(places, trust, degree), values, covariances, np.maximum(lack, 0.0))
