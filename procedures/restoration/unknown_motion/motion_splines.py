"""Subpixel motion paths: the smooth curve whose line, integrated over pixels, is a mask.

A thin line known to whole pixels cannot be stretched to other depths (5.3); a curve can. Curves are cubic splines in
time, so that they include how long the rig stays somewhere; the direction of time does not matter.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.ndimage import gaussian_filter

from procedures.restoration.masks.blur_models import LINE, path_shape, unit
from procedures.restoration.masks.blur_operator import Array, MaskStack
from procedures.restoration.masks.line_rasterisation import line_mask, line_mask_change

POINTS = 28
"""Control points of the spline: closed curves of the fourth order have errors of 0.002 pixel at a half-width of 3, and
their masks of 0.1 to 0.3 %; with 20 points 0.012 pixel and 0.2 to 0.8 %, which strong edges reveal at 40 dB."""
INSTANTS = 400
"""Points at which a curve is drawn, closer than its line width."""
STEP = 0.05
"""Step of w between the masks of a curve, pixels."""
COARSE = ((0.7, 1e-11), (0.4, 2e-12))
FINE = ((0.2, 1e-12), (0.0, 1e-12))
"""Widths of the line, pixels, and weights of steadiness, from a coarse fit that few curves miss to the line itself."""

SETTLED = 1e-3
"""Relative decrease of the cost at which the fit of a curve ends: curves are fitted again to the frame's evidence."""


@cache
def basis(instants: int = INSTANTS) -> Array:
    """Values of the splines at the centres of equal times, (instants, POINTS)."""
    return _splines((np.arange(instants) + 0.5) / instants)


@cache
def moving(instants: int) -> tuple[NDArray[np.int64], Array]:
    """The first control point of each instant, and the splines of it and the following three."""
    begins = np.minimum((basis(instants) != 0).argmax(axis=1), POINTS - 4)
    return begins, np.take_along_axis(basis(instants), begins[:, None] + np.arange(4), axis=1)


@cache
def whole() -> Array:
    """Values of the splines at equal times from start to end, (INSTANTS + 1, POINTS)."""
    return _splines(np.linspace(0, 1, INSTANTS + 1))


def _splines(times: Array) -> Array:
    knots = np.concatenate([np.zeros(3), np.linspace(0, 1, POINTS - 2), np.ones(3)])
    return np.asarray(BSpline.design_matrix(times, knots, 3).toarray())


@cache
def third_derivative_penalty() -> Array:
    """Matrix B of the mean squared third derivative c' B c of a curve of control points c, which is large at kinks."""
    third = np.diff(basis(), 3, axis=0) * INSTANTS**3
    return np.asarray(third.T @ third / INSTANTS)


def spline_mask(points: Array, R: int, sigma: float, instants: int = INSTANTS) -> Array:
    """Mask (2R + 1, 2R + 1) of the curve of control points (POINTS, 2), a line of width sigma, of sum 1 less the light
    outside."""
    return line_mask(basis(instants) @ points, R, sigma)


def path_stack(points: Array, half: float, max_w: float, R: int) -> MaskStack:
    """Masks of the curve of half-width `half` at every w: the curve stretched about the masks' centre (5.3)."""
    levels = np.maximum(np.arange(int(np.ceil(max_w / STEP)) + 2) * STEP, 0.02)
    return MaskStack(np.stack([unit(spline_mask(points * w / half, R, LINE * w)) for w in levels]), STEP)


def half_width(points: Array) -> float:
    """w of curves (..., POINTS, 2): largest distance from the centre, line included, pixels."""
    return float(np.abs(whole() @ points).max()) / (1 - 3 * LINE)


def shapes_of(points: Array) -> Array:
    """Shapes on [-1, 1] of both curves (2, POINTS, 2), with one scale."""
    curves = whole() @ points
    return np.stack([path_shape(curve, extent=float(np.abs(curves).max())) for curve in curves])


def _cost(points: Array, target: Array, sigma: float, steady: float, instants: int) -> float:
    mask = spline_mask(points, len(target) // 2, sigma, instants)
    return float(np.sum((mask - target) ** 2) + steady * np.sum(points * (third_derivative_penalty() @ points)))


def fit_spline(points: Array, target: Array, sigma: float, steady: float, instants: int) -> tuple[float, Array]:
    """Cost and points of the curve near `points` that best draws the target: Levenberg and Marquardt."""
    cost, damping = _cost(points, target, sigma, steady, instants), 1e-3
    stiff = np.kron(np.eye(2), steady * third_derivative_penalty())
    for _ in range(25):
        mask, at, J = line_mask_change(basis(instants) @ points, len(target) // 2, sigma, *moving(instants), POINTS)
        explained = J.T @ J
        H, step, before = explained + stiff, np.trace(explained) / len(stiff) * np.eye(len(stiff)), cost
        gradient = J.T @ (mask - target).ravel()[at] + stiff @ points.T.ravel()
        for _ in range(6):
            tried = points - np.linalg.solve(H + damping * step, gradient).reshape(2, -1).T
            value = _cost(tried, target, sigma, steady, instants)
            if value < cost:
                points, cost, damping = tried, value, max(damping / 5, 1e-7)
                break
            damping *= 5
        if before - cost < SETTLED * before:
            break
    return cost, points


def _moments(target: Array) -> tuple[Array, Array]:
    R = len(target) // 2
    at = np.arange(-R, R + 1.0)
    along = np.stack([target.sum(axis=0), target.sum(axis=1)]) / max(float(target.sum()), 1e-30)
    mean = along @ at
    return np.asarray(mean), np.sqrt(np.maximum(along @ at**2 - mean**2, 0.01))


def _random_start(target: Array, rng: np.random.Generator) -> Array:
    """Control points of a curve of low random oscillations with the target's position and extent."""
    mean, spread = _moments(target)
    t, orders = (np.arange(POINTS) + 0.5) / POINTS, np.arange(1, 6)
    points = np.cos(np.pi * np.outer(t, orders)) @ (rng.standard_normal((5, 2)) / orders[:, None])
    points = points - points.mean(axis=0)
    return np.asarray(points / points.std(axis=0) * spread + mean)


def fit_recorded(path: Array, mask: Array, half: float) -> Array:
    """Points of the curve that draws a mask, from the recorded path (n, 2) in any unit, at equal times."""
    mean, spread = _moments(mask)
    times = (np.arange(INSTANTS) + 0.5) / INSTANTS * (len(path) - 1)
    even = np.stack([np.interp(times, np.arange(len(path)), path[:, k]) for k in (0, 1)], axis=1)
    even = (even - even.mean(axis=0)) * np.linalg.norm(spread) / np.linalg.norm(even.std(axis=0)) + mean
    points, target, line = np.linalg.lstsq(basis(), even, rcond=None)[0], np.pad(mask, 2), LINE * half
    for sigma, steady in (*COARSE[1:], *FINE):
        wide = max(sigma, line)
        _, points = fit_spline(points, _softened(target, wide, line), wide, steady, 300)
    return np.asarray(points)


def _softened(target: Array, sigma: float, line: float) -> Array:
    return np.asarray(gaussian_filter(target, np.sqrt(max(sigma**2 - line**2, 0)), mode="constant"))


def candidates(mask: Array, half: float, rng: np.random.Generator, number: int) -> list[Array]:
    """Points of curves of half-width about `half` that nearly draw a mask: the better half of a number of starts."""
    target, line = np.pad(mask, 2), LINE * half
    curves = [_random_start(target, rng) for _ in range(number)]
    for sigma, steady in (*COARSE, FINE[0]):
        wide = max(sigma, line)
        # points of a wide line may be farther apart
        instants = int(min(60 / np.sqrt(wide), 150))
        ends = [fit_spline(points, _softened(target, wide, line), wide, steady, instants) for points in curves]
        curves = [points for _, points in sorted(ends, key=lambda end: end[0])]
        if (sigma, steady) == COARSE[-1]:
            curves = curves[: (number + 1) // 2]
    return curves
