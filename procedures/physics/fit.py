"""Parameters of a model by generalised least squares: every sample weighs as the PSF's covariance says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from procedures.physics.model import Grid, bounds_of, names_of, start_of
from procedures.physics.sensor import Parts

Array = npt.NDArray[np.float64]

RANK = 1e-9
"""Share of the covariance's largest eigenvalue under which a direction has no noise of its own.

A PSF of sum 1 has one such direction, and where its centre was fixed there may be two more: there its value is a
convention, and says nothing about a model."""
RISE_FROM, RISE_STEPS = 0.02, 12
"""Where the search for a rise of chi-square begins, of the bounds' distance, and how often it goes on."""
STARTS = ((0.06, 0.03), (0.06, -0.03))
"""Waves of defocus and spherical aberration from which fits begin; one sign of both together cannot be told from the
other, so there are two."""


@dataclass(frozen=True, eq=False)
class WhitenedPsf:
    """A PSF turned so that its noise is white: W (r, k^2) with W C W' = 1, r the covariance's rank."""

    grid: Grid
    W: Array

    @classmethod
    def of(cls, grid: Grid) -> WhitenedPsf:
        """By the eigenvectors of its covariance."""
        values, vectors = np.linalg.eigh((grid.psf.covariance + grid.psf.covariance.T) / 2)
        kept = values > RANK * values[-1]
        return cls(grid, (vectors[:, kept] / np.sqrt(values[kept])).T)

    @property
    def rank(self) -> int:
        """Numbers that the PSF gives to compare with a model."""
        return len(self.W)


@dataclass(frozen=True, eq=False)
class ModelFit:
    """A model's parameters.

    Attributes
    ----------
    p : (n,) float64
        In the order of `model.names_of`.
    covariance : (n, n) float64
        Enlarged by the share of chi-square over its freedoms, where that is over 1.
    chi2 : float
    freedom : int
    """

    parts: Parts
    p: Array
    covariance: Array
    chi2: float
    freedom: int

    def criterion(self, scale: float = 1.0) -> float:
        """Schwarz's information criterion, smaller is better, where chi-square counts in units of `scale`."""
        return self.chi2 / scale + len(self.p) * float(np.log(self.freedom + len(self.p)))


def fit_parts(data: WhitenedPsf, parts: Parts, start: Array | None = None) -> ModelFit:
    """The best parameters of a model, from one start or from `STARTS`."""
    starts = (
        [start] if start is not None else [start_of(parts, *pair) for pair in STARTS[: 2 if parts.aberrations else 1]]
    )
    low, high = bounds_of(parts)
    found = [_descend(data, parts, np.clip(one, low + 1e-6, high - 1e-6), (low, high)) for one in starts]
    return min(found, key=lambda one: one.chi2)


def start_near(fit: ModelFit, parts: Parts) -> Array:
    """Where a fit of other parts begins: at the values of a fit that has most of them."""
    known = dict(zip(names_of(fit.parts), fit.p, strict=True))
    fresh = start_of(parts, *STARTS[0])
    return np.array([known.get(name, value) for name, value in zip(names_of(parts), fresh, strict=True)])


def distance_of_rise(data: WhitenedPsf, fit: ModelFit, name: str, bound: float, inward: float) -> float:
    """How far from a bound a parameter may lie until chi-square has risen by 1 over its value at the bound.

    The other parameters follow meanwhile. Where a fit leaves more than noise would, the rise asked for is as much
    larger. A parameter whose effect begins with its square (defocus, wandering charge) has no other uncertainty there.

    Parameters
    ----------
    fit : ModelFit
        With this parameter; it is taken from there to the bound first.
    inward : float
        1 or -1, the way from the bound.
    """
    low, high = bounds_of(fit.parts)
    place = names_of(fit.parts).index(name)
    free = np.arange(len(fit.p)) != place
    reach = float(high[place] - low[place])

    def held(distance: float, start: Array) -> ModelFit:
        p = start.copy()
        p[place] = bound + inward * distance
        return _descend(data, fit.parts, p, (low, high), free)

    at = held(0.0, fit.p)
    wanted = max(at.chi2 / at.freedom, 1.0)
    distance, near, far = RISE_FROM * reach, 0.0, reach
    for _ in range(RISE_STEPS):
        rise = held(distance, at.p).chi2 - at.chi2
        if abs(rise / wanted - 1) < 0.1:
            break
        near, far = (distance, far) if rise < wanted else (near, distance)
        # between a square and a fourth power; what noise bends at first lies between known distances all the same
        distance *= float(np.clip((wanted / max(rise, 0.01 * wanted)) ** (1 / 3), 0.1, 10))
        if not near < distance < far:
            distance = (near + far) / 2
    return distance


def _descend(
    data: WhitenedPsf,
    parts: Parts,
    start: Array,
    bounds: tuple[Array, Array],
    free: npt.NDArray[np.bool_] | None = None,
) -> ModelFit:
    """The best fit from a start; what is not `free` stays there."""
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
