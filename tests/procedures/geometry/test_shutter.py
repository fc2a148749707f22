"""Row time of a shutter, from points that are exposed row by row while the chart moves."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from procedures import GeometryParameters, Outcome, calibrate_geometry
from procedures.geometry.views import ChartView, Pose

from .simulated_views import CELL_MM, Shoot, TrueCamera, plan

LENS = TrueCamera(focal_px=(1700.0, 1702.0), centre=(963.0, 534.0), size=(1920, 1080), thin_prism=(0.0,) * 4)
RATE_HZ, FRAMES, NOISE_PX = 30.0, 40, 0.3
SHOOT = Shoot(LENS, every=2)


def pose_at(time_s: float) -> Pose:
    """A chart moved by hand: sines of 0.4 to 1.2 Hz, 0.3 m/s and 60 degrees/s at most."""
    phases = 2 * np.pi * time_s * np.array([0.61, 0.83, 0.37, 0.97, 0.71, 0.53]) + np.array([0, 1, 2, 3, 4, 5.0])
    x, y, z, yaw, pitch, roll = np.sin(phases) * (90.0, 60.0, 60.0, 0.45, 0.45, 0.3)
    return Pose(Rotation.from_euler("YXZ", [yaw, pitch, roll]).as_matrix(), np.array([x, y, 650.0 + z]))


def frames(row_s: float, seed: int, still: bool = False) -> list[ChartView]:
    """Points of every frame: each where the chart is at the time of the row in which it appears."""
    rng, nodes, views = np.random.default_rng(seed), plan(SHOOT), []
    for i in range(FRAMES):
        time_s = i / RATE_HZ
        row = np.full(len(nodes), (LENS.size[1] - 1) / 2)
        for _ in range(5):
            times = time_s + row_s * (row - (LENS.size[1] - 1) / 2)
            poses = [pose_at(0.5 * i if still else t) for t in times]
            points = LENS.project(np.array([pose.R @ node + pose.t for pose, node in zip(poses, nodes, strict=True)]))
            row = points[:, 1]
        seen = ((points >= 0) & (points <= np.array(LENS.size) - 1)).all(axis=1)
        noisy = points[seen] + NOISE_PX * rng.standard_normal((seen.sum(), 2))
        covariance = np.tile(NOISE_PX**2 * np.eye(2), (seen.sum(), 1, 1))
        views.append(ChartView(f"frame{i}", np.flatnonzero(seen), noisy, covariance, time_s=time_s))
    return views


def measured(views: list[ChartView]) -> Outcome:
    parameters = GeometryParameters(CELL_MM, 0.0, "OPENCV", is_video=True)
    return calibrate_geometry(views, LENS.size, parameters, plan(SHOOT))


@pytest.mark.nightly
def test_a_readout_of_20_ms_is_measured_to_2_per_cent():
    shutter = measured(frames(0.02 / LENS.size[1], 1)).result().shutter
    assert shutter.kind == "rolling"
    assert 1080 * shutter.uncertainty_s < 0.01 * 0.02
    assert 1080 * shutter.row_s == pytest.approx(0.02, rel=0.02)
    assert abs(1080 * shutter.row_s - 0.02) < 3.5 * 1080 * shutter.uncertainty_s


def test_a_global_shutter_is_named():
    found = measured(frames(0.0, 2)).result()
    assert found.shutter.kind == "global"
    assert abs(found.numbers()["readout_time"].value) < 3 * found.numbers()["readout_time"].uncertainty
