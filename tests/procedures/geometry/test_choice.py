"""A chart outside the field of view gives an infinite residual, not an error."""

from __future__ import annotations

import numpy as np

from procedures.geometry.cameras import simple_camera
from procedures.geometry.choice import fit_pose
from procedures.geometry.views import ChartView, Pose, chart_nodes


def test_a_chart_behind_the_camera_leaves_an_infinite_residual():
    camera, nodes = simple_camera("OPENCV", (2000.0, 2000.0), (319.5, 239.5), (640, 480)), chart_nodes(0.3)
    points = camera.project(Pose(np.eye(3), np.array([0.0, 0.0, 1700.0])).apply(nodes))
    view = ChartView("view", np.arange(len(nodes)), points, np.tile(1e-4 * np.eye(2), (len(nodes), 1, 1)))
    residual = fit_pose(camera, Pose(np.eye(3), np.array([0.0, 0.0, -1700.0])), nodes, view)[1]
    assert not np.isfinite(residual).any()
