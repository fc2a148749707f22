"""A smooth surface through the cells of all flats, each flat with a slope of its own light; and a radial formula.

In logarithms all is linear: log level = log light of the flat + slope of its light . u + P(u), u in half diagonals from
the frame's centre, where P is 0. The slopes' mean is the lens's by definition: how far it may be the light's is known
from their scatter, where camera or light was turned between the flats.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from procedures.psf_field import in_half_diagonals
from procedures.vignetting.cells import Cells
from procedures.vignetting.formula import LightSurface, design_of, terms_of

Array = npt.NDArray[np.float64]

DEGREES = (2, 4, 6, 8)
FAR = 5.0
"""Robust standard deviations from the surface beyond which a cell (dust, a reflection) is left out."""
TERMS = 3
"""Of the radial formula: r^2, r^4, r^6."""


@dataclass(frozen=True, eq=False)
class Falloff:
    """The light of a plane over the frame, 1 at its centre.

    Attributes
    ----------
    light : LightSurface
    covariance : (c, c) float64
        Of its coefficients, by noise.
    slope_covariance : (2, 2) float64
        Of the mean slope of the flats' light, which is not the lens's; NaN from one flat.
    slopes : (F, 2) float64
        Of each flat's light, from their mean.
    scatter : float
        Standard deviation of the cells about the surface, in units of their noise.
    structure : float
        Root mean square of what the cells show beside surface and noise, as a share of the light.
    left_out : float
        Share of the cells.
    """

    light: LightSurface
    covariance: Array
    slope_covariance: Array
    slopes: Array
    scatter: float
    structure: float
    left_out: float

    def uncertainty(self, points: Array) -> Array:
        """Standard uncertainty of the light at points (n, 2): noise, and the flats' slope where it is known."""
        u = in_half_diagonals(points, self.light.shape)
        design = design_of(u, self.light.degree)
        variance = np.einsum("ni,ij,nj->n", design, self.covariance, design)
        return np.asarray(self.light.at(points) * np.sqrt(variance + _of_slope(u, self.slope_covariance)))


@dataclass(frozen=True, eq=False)
class RadialFalloff:
    """The light as 1 + k1 r^2 + k2 r^4 + k3 r^6, r from a centre of its own, 1 at half the frame's diagonal.

    Attributes
    ----------
    centre : (2,) float64
        (x, y) in pixels of the plane.
    coefficients : (3,) float64
    covariance : (5, 5) float64
        Of centre and coefficients.
    by_slope : (5, 2) float64
        Derivative of the same by the mean slope of the flats' light.
    lost : float, most : float
        Root mean square and largest share of light by which it differs from the surface over the frame.
    """

    centre: Array
    coefficients: Array
    covariance: Array
    by_slope: Array
    lost: float
    most: float


def _of_slope(u: Array, covariance: Array) -> Array:
    return np.asarray(np.einsum("ni,ij,nj->n", u, np.nan_to_num(covariance), u))


def fit_falloff(flats: Sequence[Cells], shape: tuple[int, int]) -> Falloff:
    """The surface of the degree that the flats ask for, by Schwarz's criterion.

    Parameters
    ----------
    flats : sequence of Cells
        Of one plane, the same cells in all.
    """
    found = [_fitted(flats, shape, degree) for degree in DEGREES]
    return min(found, key=lambda one: one[0])[1]


def _fitted(flats: Sequence[Cells], shape: tuple[int, int], degree: int) -> tuple[float, Falloff]:
    """Schwarz's criterion and the surface."""
    design, values, sigma = _system(flats, shape, degree)
    kept, whitened = np.ones(len(values), dtype=bool), design / sigma[:, None]
    for _ in range(5):
        part = whitened[kept]
        solution: Array = np.asarray(np.linalg.solve(part.T @ part, part.T @ (values / sigma)[kept]), np.float64)
        away = (values - design @ solution) / sigma
        last, kept = kept, np.abs(away) <= FAR * max(1.4826 * float(np.median(np.abs(away))), 1.0)
        if np.array_equal(last, kept):
            break
    freedom = int(kept.sum()) - design.shape[1]
    chi2 = float(np.sum(away[kept] ** 2)) / freedom
    part = whitened[kept]
    covariance = np.linalg.inv(part.T @ part) * max(chi2, 1.0)
    c, count = terms_of(degree), len(flats)
    free = solution[c + count :].reshape(-1, 2)
    slopes = np.vstack([free, -free.sum(axis=0)])
    of_slope = np.atleast_2d(np.cov(slopes.T)) / count if count > 1 else np.full((2, 2), np.nan)
    structure = max(float(np.mean((away**2 - 1)[kept] * sigma[kept] ** 2)), 0.0) ** 0.5
    schwarz = freedom * float(np.log(chi2)) + design.shape[1] * float(np.log(kept.sum()))
    light, left_out = LightSurface(shape, degree, solution[:c]), 1 - float(kept.mean())
    return schwarz, Falloff(light, covariance[:c, :c], of_slope, slopes, float(np.sqrt(chi2)), structure, left_out)


def _system(flats: Sequence[Cells], shape: tuple[int, int], degree: int) -> tuple[Array, Array, Array]:
    """Design, log levels and their sigma: columns are the surface's terms, all slopes but one."""
    count, rows = len(flats), []
    for i, flat in enumerate(flats):
        u = in_half_diagonals(flat.place, shape)
        level = np.zeros((len(u), count))
        level[:, i] = 1
        slope = np.zeros((len(u), count, 2))
        slope[:, i] = u
        free = slope[:, :-1] - slope[:, -1:]  # the slopes add to nothing
        rows.append(np.hstack([design_of(u, degree), level, free.reshape(len(u), -1)]))
    values = np.concatenate([np.log(np.maximum(flat.level, 1e-9)) for flat in flats])
    sigma = np.concatenate([flat.sigma / np.maximum(flat.level, 1e-9) for flat in flats])
    return np.vstack(rows), values, sigma


def fit_radial(found: Falloff, places: Array) -> RadialFalloff:
    """The radial formula next to a surface, over places (n, 2) of the plane.

    Its errors are those of the surface, carried through the fit.
    """
    rows, columns = found.light.shape
    unit = np.hypot(rows, columns) / 2
    u, light = in_half_diagonals(places, found.light.shape), found.light.at(places)

    def left(p: Array) -> Array:
        return np.asarray(p[0] * radial_light(np.linalg.norm(u - p[1:3], axis=1), p[3:]) / light - 1)

    fit = least_squares(left, np.array([1.0, 0, 0, -0.1, 0, 0]), x_scale=[1, 0.1, 0.1, 0.1, 0.1, 0.1])
    p = fit.x
    carried = np.linalg.pinv(fit.jac)
    design = design_of(u, found.light.degree)
    covariance = carried @ design @ found.covariance @ (carried @ design).T
    by_slope = carried @ u
    covariance += by_slope @ np.nan_to_num(found.slope_covariance) @ by_slope.T
    to_pixels = np.diag([unit, unit, *np.ones(TERMS)])
    away = left(p)
    return RadialFalloff(
        p[1:3] * unit + [(columns - 1) / 2, (rows - 1) / 2],
        p[3:],
        to_pixels @ covariance[1:, 1:] @ to_pixels,
        to_pixels @ by_slope[1:],
        float(np.sqrt(np.mean(away**2))),
        float(np.abs(away).max()),
    )


def radial_light(r: Array, k: Array) -> Array:
    """1 + k1 r^2 + k2 r^4 + k3 r^6."""
    return np.asarray(1 + k[0] * r**2 + k[1] * r**4 + k[2] * r**6)
