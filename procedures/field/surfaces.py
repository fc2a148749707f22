"""Smooth surfaces through vectors measured at positions of the frame, with their uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.numerics.arrays import Array
from procedures.numerics.scattered import Polynomial, monomials
from procedures.outcome import BadParameter
from procedures.psf import Psf
from procedures.quality import frequencies, mtf_along


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

    def coefficients(self) -> tuple[Array, Array]:
        """The polynomial's coefficients (c, m), in the order of `monomials`, and the covariance (m, c, c) of each."""
        S = self.solution()
        variance = np.diagonal(self.covariances, axis1=1, axis2=2) + self.lack
        return S @ self.values, np.einsum("ci,im,di->mcd", S, variance, S)


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
            error, share = _leave_one_out(places, values, trust, degree)
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


def _leave_one_out(places: Array, values: Array, trust: Array, degree: int) -> tuple[Array, Array]:
    """Errors (N, m) at the excluded places, and the squared weights of the others. Raises ValueError if the degree is
    undetermined."""
    error, share = np.zeros_like(values), np.zeros(len(places))
    for i in range(len(places)):
        kept = np.arange(len(places)) != i
        w = Polynomial(places[kept], trust[kept], degree).weights(places[i : i + 1])[0]
        error[i], share[i] = values[i] - w @ values[kept], w @ w
    return error, share


# --- MTF of a square photosite along a direction: the sensor's contribution to a cross in the maps of a field ---

MIN_MTF = 0.1  # below this MTF of the photosite, division by it amplifies noise and the error of its side


@dataclass(frozen=True)
class Photosite:
    """A square photosite centred in its pixel. Raises BadParameter if the fill factor is impossible.

    fill : effective area over the pixel's, including the microlens
    uncertainty : standard uncertainty of `fill`
    assumed : whether it was not measured
    """

    fill: float
    uncertainty: float = 0.0
    assumed: bool = False

    def __post_init__(self) -> None:
        if not (0 < self.fill <= 1 and 0 <= self.uncertainty < self.fill):
            raise BadParameter(
                f"a fill factor must be greater than 0 and at most 1, its uncertainty smaller; got {self.fill:g} with "
                f"an uncertainty of {self.uncertainty:g}",
                "give area over area, as `fill_factor` of station psf pattern --physics",
            )

    def mtf(self, f: Array, angle: float, pitch: int) -> tuple[Array, Array]:
        """MTF, and its change when the fill factor grows by its standard uncertainty, both (n,).

        |sinc(a fx) sinc(a fy)|, a the root of the fill factor, sinc(x) = sin(pi x) / (pi x).

        f : (n,), cycles per pixel of a plane
        angle : direction in which the detail repeats, radians from x towards y
        pitch : sensor pixels per pixel of the plane
        """
        side = float(np.sqrt(self.fill))
        u, v = (f / pitch * turn for turn in (np.cos(angle), np.sin(angle)))
        along, across = np.sinc(side * u), np.sinc(side * v)
        # d sinc(a u) / da = (cos(pi a u) - sinc(a u)) / a
        slope = (np.cos(np.pi * side * u) - along) * across + (np.cos(np.pi * side * v) - across) * along
        both = along * across
        return np.abs(both), np.sign(both) * slope / (2 * self.fill) * self.uncertainty


ASSUMED = Photosite(0.9, 0.06, assumed=True)  # an unknown sensor with microlenses: uniformly distributed from 0.8 to 1


@dataclass(frozen=True)
class WithoutPhotosite:
    """MTF of a plane divided by that of the photosite; `pitch` is that of the plane, in sensor pixels."""

    photosite: Photosite
    pitch: int = 1

    def passed(self, f: npt.ArrayLike, angle: float) -> Array:
        """The photosite's MTF at frequencies of any shape along a direction."""
        return self.photosite.mtf(np.asarray(f, dtype=np.float64), angle, self.pitch)[0]

    def curve(self, psf: Psf, f: Array, angle: float) -> tuple[Array, Array]:
        """The quotient at frequencies (n,) along a direction, and its derivative (n, p + 1): by the PSF's parameters,
        and by the fill factor in its standard uncertainties."""
        value, slope = mtf_along(psf, f, angle)
        own, own_slope = self.photosite.mtf(f, angle, self.pitch)
        own = np.maximum(own, 1e-9)
        return value / own, np.column_stack([slope, -value * own_slope / own]) / own[:, None]

    def frequencies(self, psf: Psf, angle: float) -> Array:
        """Frequencies of a curve up to `MIN_MTF` of the photosite."""
        f = frequencies(psf)
        low = self.passed(f, angle) < MIN_MTF
        return f[: int(np.argmax(low))] if low.any() else f
