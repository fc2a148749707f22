"""Projection uncertainty over the frame, and response of the camera parameters to the points.

Uncertainties of single camera parameters have little meaning: an error of the principal point is compensated by
rotations of the poses. Therefore an object at a given distance along a ray is considered as fixed to the charts. Noise
of the points changes camera and poses; the object moves with the mean of the poses; the change of its projection is the
projection error.

Source: Kogan, mrcal documentation, "Projection uncertainty", mean-pcam formulation.
"""

import cv2
import numpy as np

from procedures.geometry.adjustment import POSE, Adjustment, by_pose
from procedures.geometry.model_discrepancy import missing_terms
from procedures.numerics.arrays import Array, Mask

OUTLINE_TOLERANCE = 0.003  # simplification of outlines, relative to their size


def projection_derivative(fit: Adjustment, pixels: Array, distance_mm: float) -> Array:
    """Derivative (n, 2, M) of the projection at places (n, 2) of the frame by the unknowns of the adjustment.

    distance_mm : float, of the object along the ray; inf: only rotations have an effect
    """
    camera = fit.state.camera
    rays = camera.rays(pixels)
    unit = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    points = unit * (distance_mm if np.isfinite(distance_mm) else 1.0)
    by_points = camera.by_points(points)
    moves = by_pose(by_points, points)
    if not np.isfinite(distance_mm):
        moves = moves * np.repeat([1.0, 0.0], 3)
    p, q, count = len(camera.params), len(fit.state.terms_mm), len(fit.state.poses)
    derivative = np.zeros((len(pixels), 2, p + q + POSE * count))
    derivative[..., :p] = camera.by_params(points)
    derivative[..., p + q :] = np.tile(moves / count, count)
    return derivative


def projection_uncertainty(fit: Adjustment, pixels: Array, distance_mm: float, *, noise_only: bool = False) -> Array:
    """Root mean square length (n,), in pixels, of the projection error at places (n, 2) of the frame.

    noise_only : bool, whether to omit the camera model discrepancy, and count noise alone
    """
    J = projection_derivative(fit, pixels, distance_mm)
    squares = np.einsum("nai,ij,naj->n", J, fit.covariance * fit.scale**2, J, optimize=True)
    if fit.discrepancy is not None and not noise_only:
        errors: Array = J @ fit.discrepancy.unknowns.T
        errors += missing_terms(fit.state.camera, pixels) @ fit.discrepancy.terms.T
        squares = squares + np.einsum("nak,nak->n", errors, errors)
    return np.asarray(np.sqrt(squares))


def camera_response(fit: Adjustment) -> list[Array]:
    """Derivative (p, n, 2) of the camera parameters by the points of every view, with poses and chart adapting.

    A displacement d of a point changes the right sides by J' P d and E' P d, P its precision; the node errors are
    eliminated as in the adjustment.
    """
    state, problem = fit.state, fit.problem
    system = problem.system(state)
    inverse = np.linalg.inv(system.reduced()[0])[: len(state.camera.params)]
    of_nodes = system.solved(system.W) @ inverse.T  # (N, 3, p)
    responses = []
    for i, view in enumerate(problem.views):
        J, E = problem.jacobian(state, i)
        moved = J @ inverse[:, problem.places(state, i)].T - E @ of_nodes[view.index]  # (n, 2, p)
        precision = np.swapaxes(view.whitening, 1, 2) @ view.whitening
        responses.append(np.asarray((precision @ moved).transpose(2, 0, 1)))
    return responses


def covered_region(points: Array) -> Array:
    """Convex outline (m, 2) of the points (n, 2) of all views, within which the camera was measured."""
    outline = cv2.convexHull(points.astype(np.float32))
    few = cv2.approxPolyDP(outline, OUTLINE_TOLERANCE * float(np.ptp(points)), True)
    return np.asarray(few[:, 0], dtype=np.float64)


def enclosed(region: Array, pixels: Array) -> Mask:
    """Whether each pixel (n, 2) lies inside an outline."""
    outline = region.astype(np.float32)[:, None]
    return np.array([cv2.pointPolygonTest(outline, (float(x), float(y)), False) >= 0 for x, y in pixels])
