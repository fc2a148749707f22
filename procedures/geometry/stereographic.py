"""Stereographic projection with a radial polynomial: a formula for lenses of 20 to more than 180 degrees.

    s = 2 tan(angle / 2) (x, y) / |(x, y)|,    p = c + (fx, fy) s (1 + k1 q + k2 q^2 + k3 q^3 + k4 q^4),    q = |s|^2

It is smooth up to the direction opposite to the axis, and few terms give rectilinear, equidistant and equisolid lenses.

References
----------
Kogan, mrcal documentation, "Splined stereographic lens model".
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")
EQUIDISTANT = (-1 / 12, 1 / 80, -1 / 448, 1 / 2304)
"""First terms of the series of the angle, r = f a."""
MAX_ITERATIONS, TOLERANCE = 50, 1e-13
"""Limits of Newton's iteration for the radius."""


def project(params: Array, points: Array) -> Array:
    """Pixels (n, 2) of points (n, 3) in the camera's frame."""
    s, q = _flat(points)
    return np.asarray(params[2:4] + params[:2] * _factor(params, q)[:, None] * s)


def rays(params: Array, pixels: Array) -> Array:
    """Unit vectors (n, 3) of pixels (n, 2); NaN beyond the largest radius of the polynomial."""
    u = (pixels - params[2:4]) / params[:2]
    radius = np.linalg.norm(u, axis=1)
    s = radius.copy()
    for _ in range(MAX_ITERATIONS):
        slope = _factor(params, s * s) + 2 * s * s * _slope(params, s * s)
        step = (radius - s * _factor(params, s * s)) / slope
        s = np.maximum(s + step, 0.0)
        if not np.abs(step).max(initial=0.0) > TOLERANCE:
            break
    solved = np.abs(step) < np.sqrt(TOLERANCE)
    flat = u * np.where(solved, s / np.maximum(radius, np.finfo(float).tiny), np.nan)[:, None]
    quarter = np.sum(flat**2, axis=1, keepdims=True) / 4
    return np.asarray(np.hstack([flat, 1 - quarter]) / (1 + quarter))


def by_params(params: Array, points: Array) -> Array:
    """Derivative (n, 2, 8) of the projection of points (n, 3) by the parameters."""
    s, q = _flat(points)
    focal = (_factor(params, q)[:, None] * s)[..., None] * np.eye(2)
    centre = np.broadcast_to(np.eye(2), (len(points), 2, 2))
    powers = (params[:2] * s)[..., None] * q[:, None, None] ** np.arange(1, 5)
    return np.concatenate([focal, centre, powers], axis=-1)


def by_points(params: Array, points: Array) -> Array:
    """Derivative (n, 2, 3) of the projection of points (n, 3) by the points."""
    s, q = _flat(points)
    by_flat = _factor(params, q)[:, None, None] * np.eye(2) + 2 * _slope(params, q)[:, None, None] * (
        s[:, :, None] * s[:, None, :]
    )
    distance = np.linalg.norm(points, axis=1)
    depth = distance + points[:, 2]
    of_depth = points / distance[:, None] + np.array([0.0, 0.0, 1.0])
    flat = (2 * np.eye(2, 3) - s[:, :, None] * of_depth[:, None, :]) / depth[:, None, None]
    return np.asarray(params[:2, None] * (by_flat @ flat))


def _flat(points: Array) -> tuple[Array, Array]:
    """Stereographic coordinates (n, 2), and their squared lengths (n,)."""
    s = 2 * points[:, :2] / (np.linalg.norm(points, axis=1) + points[:, 2])[:, None]
    return s, np.sum(s * s, axis=1)


def _factor(params: Array, q: Array) -> Array:
    return np.asarray(np.polynomial.polynomial.polyval(q, [1.0, *params[4:]]))


def _slope(params: Array, q: Array) -> Array:
    """Derivative of the factor by q."""
    return np.asarray(np.polynomial.polynomial.polyval(q, params[4:] * np.arange(1, 5)))
