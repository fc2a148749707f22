import os
import subprocess
import sys

import cv2
import numpy as np
import pytest

from procedures.geometry.adjustment import by_pose, moved_pose
from procedures.geometry.cameras import MODELS, CameraModel, parameter_names, simple_camera
from procedures.geometry.views import Pose
from procedures.outcome import BadParameter

FULL = CameraModel(
    "FULL_OPENCV", np.array([900, 910, 320.25, 239.5, -0.2, 0.1, 1e-3, -2e-3, 0.02, 0.01, 0.03, -0.01]), 640, 480
)
TERMINATED = (
    "import os, signal, threading; heard = []; signal.signal(signal.SIGTERM, lambda *one: heard.append(one));"
    "thread = threading.Thread(target=__import__, args=('procedures.geometry.bundle',)); thread.start(); thread.join();"
    "os.kill(os.getpid(), signal.SIGTERM); print(len(heard))"
)
POINTS = np.random.default_rng(5).uniform([-0.3, -0.2, 0.9], [0.3, 0.2, 1.3], (40, 3))


def test_pixel_centres_are_those_of_opencv_and_colmap():
    K = np.array([[900, 0, 320.25], [0, 910, 239.5], [0, 0, 1.0]])
    seen = cv2.projectPoints(POINTS[:, None], np.zeros(3), np.zeros(3), K, FULL.params[4:])[0][:, 0]
    np.testing.assert_allclose(FULL.project(POINTS), seen, atol=1e-9)
    axis = np.array([[0.0, 0.0, 1.0]])
    np.testing.assert_allclose(FULL.project(axis), [[320.25, 239.5]], atol=1e-12)
    np.testing.assert_allclose(FULL.colmap().img_from_cam(axis), [[320.75, 240.0]], atol=1e-12)
    np.testing.assert_allclose(CameraModel.from_colmap(FULL.colmap()).params, FULL.params)


@pytest.mark.parametrize("model", MODELS)
def test_rays_lead_back_to_their_pixels(model):
    camera = simple_camera(model, (900.0, 910.0), (320.0, 240.0), (640, 480))
    bent = camera.with_params(camera.params + 1e-3 * (np.arange(len(camera.params)) > 3))
    pixels = bent.frame_grid(7, 5)
    np.testing.assert_allclose(bent.project(bent.rays(pixels)), pixels, atol=1e-6)


def test_derivatives_are_those_of_small_changes_and_unknown_models_are_refused():
    camera = simple_camera("PINHOLE", (900.0, 910.0), (320.0, 240.0), (640, 480))
    x, y, z = POINTS.T
    zero = np.zeros_like(x)
    by_params = np.stack([np.stack([x / z, zero, zero + 1, zero], -1), np.stack([zero, y / z, zero, zero + 1], -1)], 1)
    by_points = np.stack(
        [np.stack([900 / z, zero, -900 * x / z**2], -1), np.stack([zero, 910 / z, -910 * y / z**2], -1)], 1
    )
    # central differences of a smooth function in double precision: 1e-9 of the largest derivative
    np.testing.assert_allclose(camera.by_params(POINTS), by_params, atol=1e-7)
    np.testing.assert_allclose(camera.by_points(POINTS), by_points, atol=1e-6)
    pose, change = Pose(np.eye(3), np.array([0.01, -0.02, 0.1])), 1e-5 * np.array([1, -2, 3, 4, 5, -6.0])
    points = pose.apply(POINTS)
    moved = FULL.project(moved_pose(pose, change).apply(POINTS)) - FULL.project(points)
    # second order: the change, up to 6e-5 of the distance, squared times some thousand pixels
    np.testing.assert_allclose(by_pose(FULL.by_points(points), points) @ change, moved, atol=5e-6)
    with pytest.raises(BadParameter, match="no camera model 'BROWN'; name one of SIMPLE_RADIAL"):
        parameter_names("BROWN")


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_sigterm_still_stops_the_devices_after_the_import():
    done = subprocess.run([sys.executable, "-c", TERMINATED], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "1\n")
