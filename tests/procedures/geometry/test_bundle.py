"""Initial estimate of camera and poses, compared with the truth of simulated views."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from procedures.geometry.bundle import first_bundle
from procedures.geometry.views import ChartView, Pose, chart_nodes
from tests.procedures.geometry.simulated_views import TrueCamera

pytestmark = pytest.mark.delicate

LONG = TrueCamera((2450.0, 2450.0), (159.5, 119.5), (320, 240), (-3.0, 0.0, 0.0), (0.0, 0.0), (0.0,) * 4)
"""A frame of seven degrees."""
TILTS = ((-11.2, -6.2), (-35.0, 6.7), (33.2, -6.7), (8.8, 35.8), (-10.4, -34.3), (-10.4, -34.3))
PLACES = ((-64.4, 35.9), (0.0, -35.4), (0.0, 35.9), (63.7, 0.0), (-64.4, 0.0), (-64.4, 0.0))
"""Yaw and pitch in degrees; the chart's centre, right and down in mm, 2070 mm away. The first pose and that of
the opposite tilt are nearly indistinguishable."""
CELL_MM = 0.3
NOISE_PX = 0.0075


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_small_tilt_before_a_long_lens_is_not_taken_for_the_opposite_one(way, rng):
    nodes = chart_nodes(CELL_MM)[::16]
    turns = [Rotation.from_euler("YX", way * np.array(tilt), degrees=True) for tilt in TILTS]
    poses = [
        Pose(turn.as_matrix(), np.array([way * x, way * y, 2070.0])) for turn, (x, y) in zip(turns, PLACES, strict=True)
    ]
    index, covariance = np.arange(len(nodes)), np.tile(NOISE_PX**2 * np.eye(2), (len(nodes), 1, 1))
    views = [
        ChartView(str(i), index, LONG.project(pose.apply(nodes)) + rng.normal(0, NOISE_PX, (len(nodes), 2)), covariance)
        for i, pose in enumerate(poses)
    ]
    found = first_bundle(nodes, views, LONG.size)
    for pose, turn in zip(found.poses, turns, strict=True):
        assert np.degrees((Rotation.from_matrix(pose.R) * turn.inv()).magnitude()) < 5.0
    # two coordinates a point; the fit absorbs a little of the noise
    assert found.cost_px < 1.1 * np.sqrt(2) * NOISE_PX
