"""Smooth surface through the cells of all flats, with a slope of each flat's light; and a radial formula.

The model is log level = log light of the flat + log(1 + slope of its light . u) + P(u), u in half diagonals from the
frame's centre, where P is 0. P is a polynomial of the degree after that which predicts best: at the best degree, what
the polynomial lacks is as large as its noise. The mean slope is assigned to the lens; its uncertainty follows from
the scatter of the slopes, where camera or light was rotated between the flats. Where one slope turned by the same angle
from flat to flat, once around in all, explains them, the mean is free of it, and the scatter about it counts.

Source: Hall, Effect of bias estimation on coverage accuracy of bootstrap confidence intervals, Ann. Stat. 20, 1992.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.special import fdtrc

from procedures.numerics.arrays import Array
from procedures.numerics.scattered import monomials
from procedures.outcome import Refused
from procedures.psf_field import in_half_diagonals
from procedures.raw import Plane

DEGREES = (2, 4, 6, 8, 10)
OUTLIER_SIGMAS = 5.0  # robust standard deviations from the surface beyond which a cell (dust, a reflection) is excluded
FEWEST_TURNED = 3  # flats whose slopes show whether one slope turned with them
CHANCE = 0.01  # probability that independent slopes look like one that turned
ROUNDS = 5  # solutions, each with the outliers and the slopes of the one before
LEAST_SLOPE = -0.9  # relative light of a slope, less 1, at least: light is positive
TERMS = 3  # terms of the radial formula: r^2, r^4, r^6


@dataclass(frozen=True, eq=False)
class Falloff:
    """The light of a plane over the frame, 1 at its centre.

    covariance : (c, c), covariance of its coefficients by noise
    slope_covariance : (2, 2), covariance of the mean slope of the flats' light; NaN for one flat
    slopes : (F, 2), slopes of each flat's light, relative to their mean
    slope_errors : (F, 2), the same without a slope that turned with the flats
    slope_freedom : degrees of freedom of the errors along each axis
    scatter : standard deviation of the cells about the surface, in units of their noise
    structure : root mean square residual without noise, relative to the light
    excluded : share of excluded cells
    """

    light: LightSurface
    covariance: Array
    slope_covariance: Array
    slopes: Array
    slope_errors: Array
    slope_freedom: int
    scatter: float
    structure: float
    excluded: float

    def parts(self, points: Array) -> Array:
        """Standard uncertainties (2, n) of the light at points (n, 2): by noise, and by the flats' slope if known."""
        u = in_half_diagonals(points, self.light.shape)
        design = design_of(u, self.light.degree)
        by_noise = np.einsum("ni,ij,nj->n", design, self.covariance, design)
        by_slope = np.einsum("ni,ij,nj->n", u, np.nan_to_num(self.slope_covariance), u)
        return np.asarray(self.light.at(points) * np.sqrt([by_noise, by_slope]))

    def uncertainty(self, points: Array) -> Array:
        """Standard uncertainty of the light at points (n, 2)."""
        return np.asarray(np.hypot(*self.parts(points)))


@dataclass(frozen=True, eq=False)
class RadialFalloff:
    """The light as 1 + k1 r^2 + k2 r^4 + k3 r^6, r about a fitted centre, in half diagonals.

    centre : (2,), (x, y) in pixels of the plane
    coefficients : (3,) float64
    covariance : (5, 5), covariance of centre and coefficients
    by_slope : (5, 2), their derivatives by the mean slope of the flats' light
    lost : float, most : float; relative difference from the surface over the frame: root mean square and largest
    """

    centre: Array
    coefficients: Array
    covariance: Array
    by_slope: Array
    lost: float
    most: float


def fit_falloff(flats: Sequence[LightCells], shape: tuple[int, int]) -> Falloff:
    """The surface of the degree after that with the least Akaike criterion. flats : of one plane, the same cells."""
    fits = [_fitted(flats, shape, degree) for degree in DEGREES]
    best = min(range(len(fits)), key=lambda i: fits[i][0])
    return fits[min(best + 1, len(fits) - 1)][1]


def _fitted(flats: Sequence[LightCells], shape: tuple[int, int], degree: int) -> tuple[float, Falloff]:
    design, values, sigma = _system(flats, shape, degree)
    kept, whitened = np.ones(len(values), dtype=bool), design / sigma[:, None]
    c, count, bend = terms_of(degree), len(flats), np.zeros(len(values))
    for _ in range(ROUNDS):
        part = whitened[kept]
        right = part.T @ ((values - bend) / sigma)[kept]
        solution: Array = np.asarray(np.linalg.solve(part.T @ part, right), np.float64)
        slope = design[:, c + count :] @ solution[c + count :]
        bend = np.log1p(np.maximum(slope, LEAST_SLOPE)) - slope
        away = (values - bend - design @ solution) / sigma
        kept = np.abs(away) <= OUTLIER_SIGMAS * max(1.4826 * float(np.median(np.abs(away))), 1.0)
    freedom = int(kept.sum()) - design.shape[1]
    chi2 = float(np.sum(away[kept] ** 2)) / freedom
    part = whitened[kept]
    covariance = np.linalg.inv(part.T @ part) * max(chi2, 1.0)
    free = solution[c + count :].reshape(-1, 2)
    slopes = np.vstack([free, -free.sum(axis=0)])
    errors, slope_freedom = _errors_of(slopes)
    of_slope = errors.T @ errors / (slope_freedom * count) if count > 1 else np.full((2, 2), np.nan)
    structure = max(float(np.mean((away**2 - 1)[kept] * sigma[kept] ** 2)), 0.0) ** 0.5
    total = int(kept.sum())
    akaike = total * float(np.log(chi2 * freedom / total)) + 2 * design.shape[1]
    light, excluded = LightSurface(shape, degree, solution[:c]), 1 - float(kept.mean())
    return akaike, Falloff(
        light, covariance[:c, :c], of_slope, slopes, errors, slope_freedom, float(np.sqrt(chi2)), structure, excluded
    )


def _errors_of(slopes: Array) -> tuple[Array, int]:
    """Slopes (F, 2) of mean 0, less one that turned full circle with the flats where an F test requires it, and degrees
    of freedom by axis."""
    count = len(slopes)
    if count < FEWEST_TURNED:
        return slopes, count - 1
    candidates = []
    for direction in (1, -1):
        angles = direction * 2 * np.pi * np.arange(count) / count
        turns = np.array([[np.cos(angles), -np.sin(angles)], [np.sin(angles), np.cos(angles)]]).transpose(2, 0, 1)
        common = np.mean(np.swapaxes(turns, 1, 2) @ slopes[..., None], axis=0)
        candidates.append(slopes - (turns @ common)[..., 0])
    errors = min(candidates, key=lambda one: float(np.sum(one**2)))
    residual, freedom = float(np.sum(errors**2)), 2 * (count - 2)
    ratio = (float(np.sum(slopes**2)) - residual) / 2 / max(residual / freedom, np.finfo(float).tiny)
    turned = fdtrc(2, freedom, ratio) < CHANCE / len(candidates)
    return (errors, count - 2) if turned else (slopes, count - 1)


def _system(flats: Sequence[LightCells], shape: tuple[int, int], degree: int) -> tuple[Array, Array, Array]:
    """Design, log levels and their sigma; columns are the surface's terms, the levels, and all slopes but one."""
    count, rows = len(flats), []
    for i, flat in enumerate(flats):
        u = in_half_diagonals(flat.place, shape)
        level = np.zeros((len(u), count))
        level[:, i] = 1
        slope = np.zeros((len(u), count, 2))
        slope[:, i] = u
        free = slope[:, :-1] - slope[:, -1:]  # the slopes have the sum 0
        rows.append(np.hstack([design_of(u, degree), level, free.reshape(len(u), -1)]))
    values = np.concatenate([np.log(np.maximum(flat.level, 1e-9)) for flat in flats])
    sigma = np.concatenate([flat.sigma / np.maximum(flat.level, 1e-9) for flat in flats])
    return np.vstack(rows), values, sigma


def fit_radial(surface: Falloff, places: Array) -> RadialFalloff:
    """Fit of the radial formula to a surface at places (n, 2) of the plane, with its propagated uncertainty."""
    rows, columns = surface.light.shape
    unit = np.hypot(rows, columns) / 2
    u, light = in_half_diagonals(places, surface.light.shape), surface.light.at(places)

    def residual(p: Array) -> Array:
        r2 = np.sum((u - p[1:3]) ** 2, axis=1)
        return np.asarray(p[0] * (1 + r2[:, None] ** np.arange(1, TERMS + 1) @ p[3:]) / light - 1)

    fit = least_squares(residual, np.array([1.0, 0, 0, -0.1, 0, 0]), x_scale=[1, 0.1, 0.1, 0.1, 0.1, 0.1])
    p = fit.x
    inverse = np.linalg.pinv(fit.jac)
    by_coefficients, by_slope = inverse @ design_of(u, surface.light.degree), inverse @ u
    covariance = by_coefficients @ surface.covariance @ by_coefficients.T
    covariance += by_slope @ np.nan_to_num(surface.slope_covariance) @ by_slope.T
    to_pixels = np.diag([unit, unit, *np.ones(TERMS)])
    error = residual(p)
    return RadialFalloff(
        p[1:3] * unit + [(columns - 1) / 2, (rows - 1) / 2],
        p[3:],
        to_pixels @ covariance[1:, 1:] @ to_pixels,
        to_pixels @ by_slope[1:],
        float(np.sqrt(np.mean(error**2))),
        float(np.abs(error).max()),
    )


# --- Averages of a flat over cells of the frame, with their noise ---

COLUMNS = 32  # cells along the longer side: vignetting is smooth over many of them
LEAST_SIDE = 4  # minimum number of samples along a cell's side
CLIPPED, MOST_CLIPPED = 0.98, 1e-3  # level of a clipped sample, and the accepted share of them
DARK = 0.02  # minimum of a flat's median on the scale


@dataclass(frozen=True, eq=False)
class LightCells:
    """Averages over cells.

    place : (n, 2), (x, y) of the cells' centres, in pixels of the plane
    level : (n,), sigma : (n,); mean, and its standard deviation by the noise of the samples, including fixed pattern
    """

    place: Array
    level: Array
    sigma: Array


def cells_of(plane: Plane, source: str) -> LightCells:
    """The cells of a flat's plane. Raises Refused if it is clipped, dark, or too small."""
    rows, columns = plane.samples.shape
    side = max(rows, columns) // COLUMNS
    if side < LEAST_SIDE or min(rows, columns) < 6 * side:
        raise Refused(
            f"{source}: a flat needs {COLUMNS * LEAST_SIDE} pixels along its longer side; {plane.name} is "
            f"{columns} x {rows}",
            "give whole photographs of the sensor",
        )
    clipped = float(np.mean(plane.samples >= CLIPPED))
    if clipped > MOST_CLIPPED:
        raise Refused(f"{source}: {clipped:.1%} of {plane.name} are clipped", "expose a flat to half of the scale")
    middle = float(np.median(plane.samples))
    if middle < DARK:
        raise Refused(
            f"{source}: {plane.name} is at {middle:.1%} of the scale, too dark for a flat",
            "expose a flat to half of the scale",
        )
    ny, nx = rows // side, columns // side
    top, left = (rows - ny * side) // 2, (columns - nx * side) // 2
    part = plane.samples[top : top + ny * side, left : left + nx * side].astype(np.float64)
    blocks = part.reshape(ny, side, nx, side)
    level = blocks.mean(axis=(1, 3))
    steps = np.diff(blocks, axis=3)
    variance = np.mean(steps**2, axis=(1, 3)) / 2 + plane.quantisation**2 / 12
    y, x = np.meshgrid(
        top + side * np.arange(ny) + (side - 1) / 2, left + side * np.arange(nx) + (side - 1) / 2, indexing="ij"
    )
    place = np.column_stack([x.ravel(), y.ravel()])
    return LightCells(place, level.ravel(), np.sqrt(variance.ravel()) / side)


# --- The light of a plane over its frame: as a polynomial, and as even powers of a radius ---


@dataclass(frozen=True, eq=False)
class LightSurface:
    """Log light as a polynomial of the position.

    shape : (rows, columns) of the plane; coefficients : (c,) coefficients of the monomials of the position in half
    diagonals from the frame's centre, without the constant.
    """

    shape: tuple[int, int]
    degree: int
    coefficients: Array

    def __post_init__(self) -> None:
        if self.coefficients.shape != (terms_of(self.degree),) or not np.isfinite(self.coefficients).all():
            raise ValueError(f"a surface of degree {self.degree} needs {terms_of(self.degree)} finite coefficients")

    def at(self, points: Array) -> Array:
        """Light at points (n, 2) of the plane, relative to the frame's centre."""
        return np.asarray(np.exp(design_of(in_half_diagonals(points, self.shape), self.degree) @ self.coefficients))


@dataclass(frozen=True, eq=False)
class EvenPowers:
    """A (1 + sum over i of terms[i] r^(2 i + 2)), and its relative error: rms and largest."""

    terms: Array
    lost: float
    most: float


def terms_of(degree: int) -> int:
    """Number of coefficients of a surface."""
    return (degree + 1) * (degree + 2) // 2 - 1


def design_of(u: Array, degree: int) -> Array:
    """The monomials without the constant at u (n, 2), (n, c)."""
    return monomials(u, degree)[:, 1:]


def even_powers(r: Array, values: Array, count: int) -> EvenPowers:
    """Least-squares fit of even powers of r (n,) to values (n,), by relative error, with free A."""
    design = r[:, None] ** (2 * np.arange(count + 1))
    c = np.linalg.lstsq(design / values[:, None], np.ones(len(values)), rcond=None)[0]
    error = design @ c / values - 1
    return EvenPowers(c[1:] / c[0], float(np.sqrt(np.mean(error**2))), float(np.abs(error).max()))
