import re

import numpy as np
import pytest

from procedures.geometry.bundle import first_bundle
from procedures.geometry.cameras import MODELS, STEREOGRAPHIC, CameraModel
from procedures.geometry.stereographic import EQUIDISTANT
from procedures.geometry.views import ChartView, chart_nodes
from station.calibration.exports.geometry import export_camera
from station.calibration.stored_cameras import StoredCamera
from tests.benchmarks.fisheye_views import CELL_MM, polynomial, poses

CAMERA = CameraModel(
    STEREOGRAPHIC,
    np.array([1000.0, 1003, 1500, 990, -0.08, 0.01, -0.002, 2e-4, 1e-3, -2e-3, 5e-4, 1e-4, -1e-3, 2e-4, 3e-4, -2e-4]),
    3000,
    2000,
)
RAYS = np.array([(np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)) for a in (0.1, 0.9, 1.7) for b in (0, 1, 4)])
"""Up to 97 degrees from the axis."""


def test_rays_projection_and_derivatives_agree_beyond_90_degrees():
    np.testing.assert_allclose(CAMERA.rays(CAMERA.project(3.0 * RAYS)), RAYS, atol=1e-12)
    J, E, h = CAMERA.by_params(RAYS), CAMERA.by_points(RAYS), 1e-6
    for i, axis in enumerate(np.eye(16)):
        ahead, behind = (CAMERA.with_params(CAMERA.params + sign * h * axis).project(RAYS) for sign in (1, -1))
        np.testing.assert_allclose(J[..., i], (ahead - behind) / (2 * h), rtol=1e-5, atol=1e-5)
    for i, axis in enumerate(np.eye(3)):
        np.testing.assert_allclose(
            E[..., i],
            (CAMERA.project(RAYS + h * axis) - CAMERA.project(RAYS - h * axis)) / (2 * h),
            rtol=1e-5,
            atol=1e-4,
        )


@pytest.mark.parametrize("degrees", [10, 40, 70])
def test_the_series_of_the_equidistant_lens(degrees):
    lens = CameraModel(STEREOGRAPHIC, np.array([1000.0, 1000.0, 0, 0, *EQUIDISTANT, *(0.0,) * 8]), 3000, 2000)
    angle = np.radians(degrees)
    x = lens.project(np.array([[np.sin(angle), 0.0, np.cos(angle)]]))[0, 0]
    # the next term of the series, with q = 4 tan^2(angle / 2)
    assert x == pytest.approx(1000 * angle, rel=(4 * np.tan(angle / 2) ** 2) ** 5 / 11264 + 1e-9)


@pytest.mark.nightly
def test_views_at_90_degrees_from_the_axis_give_a_first_camera():
    lens = polynomial((3000, 2000), 790.0, (1503.0, 1004.0), (0.02, -0.006, 0.001, 0.0))
    nodes = chart_nodes(CELL_MM)[::7]
    index = np.arange(len(nodes))
    covariance = np.tile(1e-4 * np.eye(2), (len(index), 1, 1))
    views = [
        ChartView(f"{i}", index, lens.project(nodes[index] @ pose.R.T + pose.t), covariance)
        for i, pose in enumerate(poses(lens, 12, 500.0, 30.0))
    ]
    angles = [np.degrees(np.arccos(lens.rays(view.points)[:, 2].min())) for view in views]
    assert max(angles) > 90
    bundle = first_bundle(nodes, views, lens.size)
    assert bundle.camera.model == STEREOGRAPHIC
    # four terms of a series leave a small part of the lens's polynomial
    assert bundle.cost_px < 0.5


def test_colmap_gets_a_model_that_it_has():
    region = np.array([[800.0, 500.0], [2200.0, 500.0], [2200.0, 1500.0], [800.0, 1500.0]])
    export = export_camera(StoredCamera(CAMERA, region, "a fisheye"), "colmap")
    assert export.data.decode().splitlines()[-1].split()[1] in MODELS
    assert float(re.findall(r"[\d.]+", export.lost[0])[1]) < 0.5
