"""Stereographic projection with polynomials: a formula for lenses of 20 to more than 180 degrees.

    s = 2 tan(angle / 2) (x, y) / |(x, y)|,    q = |s|^2,    p = c + (fx, fy) (s (1 + k1 q + ... + k4 q^4) + a(s))

The radial polynomial is smooth up to the direction opposite to the axis, and few terms give rectilinear, equidistant
and equisolid lenses. The asymmetric terms a(s) are those of decentring and thin prism, each of two orders, as COLMAP
defines the latter; with u = p1 + p3 q and v = p2 + p4 q,

    a = (2 u sx sy + v (q + 2 sx^2) + s1 q + s2 q^2, u (q + 2 sy^2) + 2 v sx sy + s3 q + s4 q^2)

A turned camera with a displaced principal point differs from the first only in terms of the second orders: without p3
and p4, what formulas of a pinhole have of these would appear as a displacement.

Source: Kogan, mrcal documentation, "Splined stereographic lens model".
"""

import numpy as np

from procedures.numerics.arrays import Array

NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4", "p1", "p2", "s1", "s2", "s3", "s4", "p3", "p4")
RADIAL = slice(4, 8)
PRIOR = 1.5e-3  # prior standard deviation of p1 to p4: what real lenses have
EQUIDISTANT = (-1 / 12, 1 / 80, -1 / 448, 1 / 2304)  # first terms of the series of the angle, r = f a
MAX_ITERATIONS, TOLERANCE = 50, 1e-13  # limits of Newton's iteration for the radius


def project(params: Array, points: Array) -> Array:
    """Pixels (n, 2) of points (n, 3) in the camera's frame."""
    s, q = _flat(points)
    return np.asarray(params[2:4] + params[:2] * _bent(params, s, q))


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
    if params[RADIAL.stop :].any():
        flat = _unbent(params, u, flat)
    quarter = np.sum(flat**2, axis=1, keepdims=True) / 4
    return np.asarray(np.hstack([flat, 1 - quarter]) / (1 + quarter))


def _unbent(params: Array, u: Array, flat: Array) -> Array:
    """Stereographic coordinates (n, 2) whose image is u, by Newton's iteration from those of the radial terms."""
    for _ in range(MAX_ITERATIONS):
        q = np.sum(flat**2, axis=1)
        step = np.linalg.solve(_by_flat(params, flat, q), (u - _bent(params, flat, q))[..., None])[..., 0]
        flat = flat + step
        if not np.nanmax(np.abs(step), initial=0.0) > TOLERANCE:
            break
    return flat


def by_params(params: Array, points: Array) -> Array:
    """Derivative (n, 2, 16) of the projection of points (n, 3) by the parameters."""
    s, q = _flat(points)
    focal = _bent(params, s, q)[..., None] * np.eye(2)
    centre = np.broadcast_to(np.eye(2), (len(points), 2, 2))
    powers = s[..., None] * q[:, None, None] ** np.arange(1, 5)
    terms = np.concatenate([powers, np.stack(_asymmetric(s, q)).transpose(1, 2, 0)], axis=-1)
    return np.concatenate([focal, centre, params[:2, None] * terms], axis=-1)


def by_points(params: Array, points: Array) -> Array:
    """Derivative (n, 2, 3) of the projection of points (n, 3) by the points."""
    s, q = _flat(points)
    distance = np.linalg.norm(points, axis=1)
    depth = distance + points[:, 2]
    of_depth = points / distance[:, None] + np.array([0.0, 0.0, 1.0])
    flat = (2 * np.eye(2, 3) - s[:, :, None] * of_depth[:, None, :]) / depth[:, None, None]
    return np.asarray(params[:2, None] * (_by_flat(params, s, q) @ flat))


def _flat(points: Array) -> tuple[Array, Array]:
    """Stereographic coordinates (n, 2), and their squared lengths (n,)."""
    s = 2 * points[:, :2] / (np.linalg.norm(points, axis=1) + points[:, 2])[:, None]
    return s, np.sum(s * s, axis=1)


def _bent(params: Array, s: Array, q: Array) -> Array:
    """Image (n, 2) of stereographic coordinates, in focal lengths from the centre."""
    p1, p2, s1, s2, s3, s4, p3, p4 = params[RADIAL.stop :]
    u, v = p1 + p3 * q, p2 + p4 * q
    moved = np.column_stack([q * (v + s1 + s2 * q), q * (u + s3 + s4 * q)])
    return np.asarray((_factor(params, q) + 2 * (s[:, 0] * v + s[:, 1] * u))[:, None] * s + moved)


def _by_flat(params: Array, s: Array, q: Array) -> Array:
    (x, y), (p1, p2, s1, s2, s3, s4, p3, p4) = s.T, params[RADIAL.stop :]
    u, v = p1 + p3 * q, p2 + p4 * q
    more = 2 * np.stack([2 * p3 * x * y + p4 * (q + 2 * x * x), p3 * (q + 2 * y * y) + 2 * p4 * x * y])
    radial = _factor(params, q)[:, None, None] * np.eye(2) + 2 * _slope(params, q)[:, None, None] * (
        s[:, :, None] * s[:, None, :]
    )
    along, down = s1 + 2 * s2 * q, s3 + 2 * s4 * q
    rows = [
        [2 * (u * y + 3 * v * x + along * x), 2 * (u * x + v * y + along * y)],
        [2 * (u * x + v * y + down * x), 2 * (3 * u * y + v * x + down * y)],
    ]
    return np.asarray(radial + (np.array(rows) + more[:, None] * s.T).transpose(2, 0, 1))


def _asymmetric(s: Array, q: Array) -> list[Array]:
    """Displacements (n, 2) by p1 to p4 in the order of NAMES."""
    (x, y), none = s.T, 0 * q
    decentring = [np.array([2 * x * y, q + 2 * y * y]), np.array([q + 2 * x * x, 2 * x * y])]
    terms = [*decentring, (q, none), (q * q, none), (none, q), (none, q * q), *(q * term for term in decentring)]
    return [np.column_stack(term) for term in terms]


def _factor(params: Array, q: Array) -> Array:
    k1, k2, k3, k4 = params[RADIAL]
    return np.asarray(1 + q * (k1 + q * (k2 + q * (k3 + q * k4))))


def _slope(params: Array, q: Array) -> Array:
    k1, k2, k3, k4 = params[RADIAL]
    return np.asarray(k1 + q * (2 * k2 + q * (3 * k3 + q * 4 * k4)))
