from __future__ import annotations

import numpy as np
import pytest

from procedures.geometry.cameras import CameraModel
from procedures.geometry.conversion import as_model, as_opencv
from procedures.outcome import BadParameter

from .simulated_views import TrueCamera

FULL = CameraModel(
    "FULL_OPENCV", np.array([5200, 5204, 3012, 1989, -0.12, 0.06, 4e-4, -3e-4, -0.01, 0, 0, 0.0]), 6000, 4000
)
WHOLE = np.array([[0.0, 0], [5999, 0], [5999, 3999], [0, 3999]])


def test_the_same_formula_is_copied_exactly():
    found = as_opencv(FULL, WHOLE, 8)
    np.testing.assert_array_equal(found.distortion, FULL.params[4:])
    assert found.difference.max_px < 1e-6  # accuracy of the rays


def test_the_error_of_fewer_coefficients_is_reported():
    found = as_opencv(FULL, WHOLE, 4)
    rays = TrueCamera(thin_prism=(0, 0, 0, 0)).rays(FULL.frame_grid(9, 7))
    error = np.linalg.norm(found.project(rays) - FULL.project(rays), axis=1)
    assert 1e-3 < found.difference.rms_px < 1
    assert error.max() == pytest.approx(found.difference.max_px, rel=0.2)  # of another grid


def test_an_equidistant_lens_is_represented_by_its_own_formula():
    lens = CameraModel("OPENCV_FISHEYE", np.array([1500.0, 1500, 960, 540, 0.02, -0.01, 0.003, 0]), 1920, 1080)
    found, difference = as_model(lens, np.array([[0.0, 0], [1919, 0], [1919, 1079], [0, 1079]]), "OPENCV_FISHEYE")
    assert difference.max_px < 1e-4
    np.testing.assert_allclose(found.params[:4], lens.params[:4], atol=1e-3)


def test_opencv_has_no_formula_of_six_coefficients():
    with pytest.raises(BadParameter, match="coefficients, not 6"):
        as_opencv(FULL, WHOLE, 6)
