from dataclasses import replace

import numpy as np

from procedures.geometry.adjustment import POSE, adjust, moved_pose
from procedures.geometry.uncertainty import (
    camera_response,
    covered_region,
    enclosed,
    projection_derivative,
    projection_uncertainty,
)


def test_projection_agrees_with_its_derivative_and_is_known_worse_outside_the_charts(geometry):
    fit, rng = geometry.adjustment, np.random.default_rng(8)
    pixels, distance = geometry.camera.frame_grid(4, 3), 500.0
    change = 1e-2 * np.sqrt(np.diag(fit.covariance)) * rng.standard_normal(len(fit.covariance))
    p, q = len(geometry.camera.params), len(fit.state.terms_mm)
    rays = geometry.camera.rays(pixels)
    points = distance * rays / np.linalg.norm(rays, axis=1, keepdims=True)
    moved = []
    for i, pose in enumerate(fit.state.poses):
        after = moved_pose(pose, change[p + q + POSE * i : p + q + POSE * (i + 1)])
        moved.append((points - pose.t) @ pose.R @ after.R.T + after.t)  # fixed to the chart of this view
    camera = geometry.camera.with_params(geometry.camera.params + change[:p])
    seen = camera.project(np.mean(moved, axis=0))
    np.testing.assert_allclose(projection_derivative(fit, pixels, distance) @ change, seen - pixels, atol=1e-6)
    inside, corner = np.array([geometry.camera.centre]), np.array([[0.0, 0.0]])
    near = geometry.maps[0].distance_mm
    assert projection_uncertainty(geometry.adjustment, corner, near) > 2 * projection_uncertainty(
        geometry.adjustment, inside, near
    )
    assert not geometry.misfit.significant
    assert geometry.misfit.rms_px < 0.005


def test_the_response_predicts_the_change_of_the_camera_within_its_covariance(geometry):
    square = np.array([[10.0, 10], [20, 10], [20, 20], [10, 20], [15, 15]])
    region = covered_region(square)
    assert len(region) == 4
    np.testing.assert_array_equal(enclosed(region, np.array([[15.0, 12], [10, 10], [9, 9]])), [True, True, False])
    rng = np.random.default_rng(21)
    before = adjust(geometry.adjustment.state, geometry.adjustment.problem)
    views, response = before.problem.views, camera_response(before)
    moves = [0.03 * rng.standard_normal(view.points.shape) for view in views]  # three times the points' own noise
    moved = [replace(view, points=view.points + move) for view, move in zip(views, moves, strict=True)]
    after = adjust(before.state, replace(before.problem, views=moved))
    change = after.state.camera.params - before.state.camera.params
    expected = sum(np.einsum("pna,na->p", r, move) for r, move in zip(response, moves, strict=True))
    spread = np.sqrt(np.diag(before.covariance)[: len(change)])
    assert np.abs(expected / spread).max() > 2
    # both adjustments converge to a thirtieth of an uncertainty; the model is slightly nonlinear over three
    np.testing.assert_allclose(change / spread, expected / spread, atol=0.15)
    fit = geometry.adjustment
    carried = np.zeros((len(geometry.camera.params),) * 2)
    for view, response in zip(fit.problem.views, camera_response(fit), strict=True):
        carried += np.einsum("pna,nab,qnb->pq", response, view.covariance, response)
    whole = fit.covariance[: len(carried), : len(carried)]
    # the rest of the covariance is due to print and priors: positive semidefinite
    assert np.linalg.eigvalsh(whole - carried).min() > -1e-9 * np.linalg.eigvalsh(whole).max()
    assert np.diag(carried / whole).max() <= 1
    assert np.diag(carried / whole).min() > 0.02
