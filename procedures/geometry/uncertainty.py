"""How well the frame is known: the uncertainty of where things at a distance are seen, propagated from the points' own.

A camera's numbers mean nothing by themselves: a principal point that is off comes with poses that are turned, and the
two together put the charts where they were seen. So a place of the frame is taken for what it looks at, a point at a
distance, and that point is thought to be fixed to the charts. An error of the points moves the camera's numbers and all
poses; the fixed point moves as the poses do on average; where it is then seen is the error of the projection there.

References
----------
Kogan, mrcal documentation, "Projection uncertainty", mean-pcam formulation.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from procedures.geometry.adjustment import POSE, Adjustment, by_pose

Array = npt.NDArray[np.float64]

ROUGHLY = 0.003
"""How far an outline's corners may be cut, over its size: people and other programs read it."""


def projection_derivative(found: Adjustment, pixels: Array, distance_mm: float) -> Array:
    """How places of the frame (n, 2) move with the adjustment's unknowns, (n, 2, M).

    Parameters
    ----------
    distance_mm : float
        Of what is looked at, along the ray; inf: only turns count then.
    """
    camera = found.state.camera
    rays = camera.rays(pixels)
    unit = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    points = unit * (distance_mm if np.isfinite(distance_mm) else 1.0)
    by_points = camera.by_points(points)
    moves = by_pose(by_points, points)
    if not np.isfinite(distance_mm):
        moves = moves * np.repeat([1.0, 0.0], 3)
    p, q, count = len(camera.params), len(found.state.terms_mm), len(found.state.poses)
    derivative = np.zeros((len(pixels), 2, p + q + POSE * count))
    derivative[..., :p] = camera.by_params(points)
    derivative[..., p + q :] = np.tile(moves / count, count)
    return derivative


def projection_covariance(found: Adjustment, pixels: Array, distance_mm: float) -> Array:
    """Covariance (n, 2, 2), in squared pixels, of where things that are seen at places (n, 2) are projected."""
    J = projection_derivative(found, pixels, distance_mm)
    return np.asarray(J @ (found.covariance * found.scale**2) @ np.swapaxes(J, 1, 2))


def projection_uncertainty(found: Adjustment, pixels: Array, distance_mm: float) -> Array:
    """Root mean square length (n,), in pixels, of the projection's error at places (n, 2) of the frame."""
    return np.asarray(np.sqrt(np.einsum("naa->n", projection_covariance(found, pixels, distance_mm))))


def seen_region(points: Array) -> Array:
    """The convex outline (m, 2) of all points (n, 2) of the views: inside it the camera was measured."""
    outline = cv2.convexHull(points.astype(np.float32))
    few = cv2.approxPolyDP(outline, ROUGHLY * float(np.ptp(points)), True)
    return np.asarray(few[:, 0], dtype=np.float64)


def enclosed(region: Array, pixels: Array) -> npt.NDArray[np.bool_]:
    """Which of the pixels (n, 2) lie inside an outline."""
    outline = region.astype(np.float32)[:, None]
    return np.array([cv2.pointPolygonTest(outline, (float(x), float(y)), False) >= 0 for x, y in pixels])
