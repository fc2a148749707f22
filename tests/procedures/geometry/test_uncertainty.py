from __future__ import annotations

import numpy as np

from procedures.geometry.adjustment import POSE, moved_pose
from procedures.geometry.misfit import find_misfit
from procedures.geometry.shape import shape_model
from procedures.geometry.uncertainty import enclosed, projection_derivative, projection_uncertainty, seen_region


def test_projection_moves_as_its_derivative_says(geometry):
    found, rng = geometry.adjustment, np.random.default_rng(8)
    pixels, distance = geometry.camera.frame_grid(4, 3), 500.0
    change = 1e-2 * np.sqrt(np.diag(found.covariance)) * rng.standard_normal(len(found.covariance))
    p, q = len(geometry.camera.params), len(found.state.terms_mm)
    rays = geometry.camera.rays(pixels)
    points = distance * rays / np.linalg.norm(rays, axis=1, keepdims=True)
    moved = []
    for i, pose in enumerate(found.state.poses):
        after = moved_pose(pose, change[p + q + POSE * i : p + q + POSE * (i + 1)])
        moved.append((points - pose.t) @ pose.R @ after.R.T + after.t)  # fixed to the chart of this view
    camera = geometry.camera.with_params(geometry.camera.params + change[:p])
    seen = camera.project(np.mean(moved, axis=0))
    np.testing.assert_allclose(projection_derivative(found, pixels, distance) @ change, seen - pixels, atol=1e-6)


def test_the_frame_is_known_worse_outside_what_the_charts_covered(geometry):
    inside, corner = np.array([geometry.camera.centre]), np.array([[0.0, 0.0]])
    near = geometry.maps[0].distance_mm
    assert projection_uncertainty(geometry.adjustment, corner, near) > 2 * projection_uncertainty(
        geometry.adjustment, inside, near
    )


def test_a_right_model_leaves_no_field(geometry, taken):
    views = [one.view for one in geometry.views]
    misfit = find_misfit(geometry.adjustment, taken.nodes, views, shape_model(taken.nodes, geometry.shape.node_mm[0]))
    assert not misfit.significant
    assert misfit.rms_px < 0.005


def test_the_region_holds_its_points_and_not_the_corners():
    square = np.array([[10.0, 10], [20, 10], [20, 20], [10, 20], [15, 15]])
    region = seen_region(square)
    assert len(region) == 4
    np.testing.assert_array_equal(enclosed(region, np.array([[15.0, 12], [10, 10], [9, 9]])), [True, True, False])
