"""Model parameters by generalised least squares, weighted by the PSF's covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from procedures.numerics.arrays import Array
from procedures.physics.model import Grid, bounds_of, names_of, start_of
from procedures.physics.sensor import ModelParts

RANK = 1e-9
"""Fraction of the covariance's largest eigenvalue below which a direction is taken as free of noise.

A PSF of sum 1 has one such direction, and two more where its centre was fixed. The value along such a direction is a
convention and carries no information about a model."""
RISE_FROM, RISE_STEPS = 0.02, 12
"""Start of the search for a rise of chi-square, as a fraction of the parameter's range, and maximum of iterations."""
STARTS = ((0.06, 0.03), (0.06, -0.03))
"""Starting values of defocus and spherical aberration in waves: a fit does not leave the wrong relative sign of the
two, so both signs are tried."""


@dataclass(frozen=True, eq=False)
class WhitenedPsf:
    """A PSF transformed to white noise: W (r, k^2) with W C W' = 1, r the rank of the covariance C."""

    grid: Grid
    W: Array

    @classmethod
    def of(cls, grid: Grid) -> WhitenedPsf:
        """Whiten by the eigenvectors of the covariance."""
        values, vectors = np.linalg.eigh((grid.psf.covariance + grid.psf.covariance.T) / 2)
        kept = values > RANK * values[-1]
        return cls(grid, (vectors[:, kept] / np.sqrt(values[kept])).T)

    @property
    def rank(self) -> int:
        """Number of independent data."""
        return len(self.W)


@dataclass(frozen=True, eq=False)
class ModelFit:
    """A fitted model.

    p : (n,) parameters in the order of `model.names_of`; covariance : (n, n) scaled by the reduced chi-square where
    that exceeds 1.
    """

    parts: ModelParts
    p: Array
    covariance: Array
    chi2: float
    freedom: int

    def criterion(self, scale: float = 1.0) -> float:
        """Schwarz's information criterion, smaller is better; chi-square is divided by `scale`."""
        return self.chi2 / scale + len(self.p) * float(np.log(self.freedom + len(self.p)))


def fit_parts(data: WhitenedPsf, parts: ModelParts, start: Array | None = None) -> ModelFit:
    """The best parameters of a model, from one start or from `STARTS`."""
    pairs = STARTS if parts.aberrations else STARTS[:1]
    starts = [start_of(parts, *pair) for pair in pairs] if start is None else [start]
    low, high = bounds_of(parts)
    fits = [_descend(data, parts, np.clip(first, low + 1e-6, high - 1e-6), (low, high)) for first in starts]
    return min(fits, key=lambda fit: fit.chi2)


def start_near(fit: ModelFit, parts: ModelParts) -> Array:
    """Starting values for a model with other parts, taken from a fit that shares most of them."""
    known = dict(zip(names_of(fit.parts), fit.p, strict=True))
    fresh = start_of(parts, *STARTS[0])
    return np.array([known.get(name, value) for name, value in zip(names_of(parts), fresh, strict=True)])


def distance_of_rise(data: WhitenedPsf, fit: ModelFit, name: str, bound: float, inward: float) -> float:
    """Distance from a bound at which chi-square, minimised over the other parameters, has risen by 1.

    Where the fit's residual exceeds the noise, the required rise is larger by the reduced chi-square. For a parameter
    whose effect begins with its square (defocus, diffusion) this is the only uncertainty at the bound.

    fit : includes this parameter; its start is moved to the bound first
    inward : 1 or -1, direction from the bound into the range
    """
    low, high = bounds_of(fit.parts)
    place = names_of(fit.parts).index(name)
    free = np.arange(len(fit.p)) != place
    reach = float(high[place] - low[place])

    def fit_at(distance: float, start: Array) -> ModelFit:
        p = start.copy()
        p[place] = bound + inward * distance
        return _descend(data, fit.parts, p, (low, high), free)

    at = fit_at(0.0, fit.p)
    target = max(at.chi2 / at.freedom, 1.0)
    distance, near, far = RISE_FROM * reach, 0.0, reach
    for _ in range(RISE_STEPS):
        rise = fit_at(distance, at.p).chi2 - at.chi2
        if abs(rise / target - 1) < 0.1:
            break
        near, far = (distance, far) if rise < target else (near, distance)
        # chi-square rises with the second to fourth power; noise may bend the first part, the bracket holds anyway
        distance *= float(np.clip((target / max(rise, 0.01 * target)) ** (1 / 3), 0.1, 10))
        if not near < distance < far:
            distance = (near + far) / 2
    return distance


def _descend(
    data: WhitenedPsf,
    parts: ModelParts,
    start: Array,
    bounds: tuple[Array, Array],
    free: npt.NDArray[np.bool_] | None = None,
) -> ModelFit:
    """Best fit from a start; parameters that are not `free` are held."""
    moves = np.ones(len(start), dtype=bool) if free is None else free
    cache: dict[bytes, tuple[Array, Array]] = {}

    def evaluated(x: Array) -> tuple[Array, Array]:
        key = x.tobytes()
        if key not in cache:
            cache.clear()
            cache[key] = data.grid.model(parts, placed(x))
        return cache[key]

    def placed(x: Array) -> Array:
        p = start.copy()
        p[moves] = x
        return p

    measured = data.grid.psf.h.ravel()
    inside = np.clip(start, bounds[0] + 1e-9, bounds[1] - 1e-9)
    done = least_squares(
        lambda x: data.W @ (evaluated(x)[0] - measured),
        inside[moves],
        jac=lambda x: data.W @ evaluated(x)[1][:, moves],
        bounds=(bounds[0][moves], bounds[1][moves]),
        xtol=1e-6,
        ftol=1e-6,
        gtol=1e-6,
        max_nfev=30,
    )
    chi2, freedom = 2 * float(done.cost), data.rank - int(moves.sum())
    covariance = np.zeros((len(start), len(start)))
    covariance[np.ix_(moves, moves)] = np.linalg.pinv(done.jac.T @ done.jac, rcond=1e-12) * max(chi2 / freedom, 1.0)
    return ModelFit(parts, placed(np.asarray(done.x, dtype=np.float64)), covariance, chi2, freedom)
