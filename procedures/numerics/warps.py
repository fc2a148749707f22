"""Plane-to-plane maps: homographies, and polynomial displacements that follow them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

CUBIC_EXPONENTS = tuple((i - j, j) for i in range(1, 4) for j in range(i + 1))
"""Exponents (of x, of y) of the monomials of degree one to three, lowest degree first."""


def apply_homography(H: Array, points: Array) -> Array:
    """Points (n, 2) mapped by the homography H (3, 3)."""
    mapped = points @ H[:, :2].T + H[:, 2]
    return np.asarray(mapped[:, :2] / mapped[:, 2:])


def inverse(H: Array) -> Array:
    """The inverse of a square matrix."""
    return np.asarray(np.linalg.inv(H), dtype=np.float64)


def fit_homography(source: Array, target: Array) -> Array:
    """The homography (3, 3) that best maps `source` to `target`, both (n >= 4, 2), by least squares in the target.

    A direct linear solution on normalised points starts three Gauss-Newton steps on the distances in the target.

    Raises
    ------
    ValueError
        If there are fewer than four points.
    """
    if len(source) < 4:
        raise ValueError(f"a homography needs four points; got {len(source)}")
    S, T = _normalisation(source), _normalisation(target)
    a, b = apply_homography(S, source), apply_homography(T, target)
    zero = np.zeros((len(a), 3))
    ones = np.column_stack([a, np.ones(len(a))])
    rows = np.vstack(
        [np.hstack([ones, zero, -b[:, :1] * ones]), np.hstack([zero, ones, -b[:, 1:] * ones])],
    )
    h = np.linalg.svd(rows)[2][-1]
    h = h / h[8]
    for _ in range(3):
        h = h + _gauss_newton_step(h, a, b)
    H = np.linalg.inv(T) @ h.reshape(3, 3) @ S
    return np.asarray(H / H[2, 2])


def _gauss_newton_step(h: Array, a: Array, b: Array) -> Array:
    """Change of the homography's nine numbers (the last stays) that lowers the distances |H a - b|."""
    w = a @ h[6:8] + h[8]
    found = apply_homography(h.reshape(3, 3), a)
    ones = np.column_stack([a, np.ones(len(a))]) / w[:, None]
    zero = np.zeros_like(ones)
    perspective = a / w[:, None]
    J = np.vstack(
        [np.hstack([ones, zero, -found[:, :1] * perspective]), np.hstack([zero, ones, -found[:, 1:] * perspective])],
    )
    step = np.linalg.lstsq(J, (b - found).T.ravel(), rcond=None)[0]
    return np.append(step, 0.0)


def _normalisation(points: Array) -> Array:
    """The similarity that puts the points' centroid at 0 and their mean distance to it at sqrt 2."""
    centre = points.mean(axis=0)
    scale = np.sqrt(2) / np.linalg.norm(points - centre, axis=1).mean()
    return np.array([[scale, 0, -scale * centre[0]], [0, scale, -scale * centre[1]], [0, 0, 1]])


def homography_jacobian(H: Array, point: Array) -> Array:
    """Derivative (2, 2) of the homography at a point (2,): rows are target coordinates, columns source ones."""
    w = H[2, :2] @ point + H[2, 2]
    mapped = (H[:2, :2] @ point + H[:2, 2]) / w
    return np.asarray((H[:2, :2] - np.outer(mapped, H[2, :2])) / w)


def cubic_monomials(x: Array, y: Array) -> Array:
    """The nine monomials of degree one to three at points (n,): (n, 9), in the order of `CUBIC_EXPONENTS`."""
    xx, xy, yy = x * x, x * y, y * y
    return np.stack([x, y, xx, xy, yy, xx * x, xx * y, x * yy, yy * y], axis=-1)
