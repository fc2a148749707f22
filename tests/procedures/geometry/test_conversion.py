import cv2
import numpy as np
import pytest

from procedures.geometry.cameras import CameraModel
from procedures.geometry.conversion import Difference, KalibrCamera, as_kalibr, as_model, as_opencv
from procedures.outcome import BadParameter

from .simulated_views import TrueCamera

FULL = CameraModel(
    "FULL_OPENCV", np.array([5200, 5204, 3012, 1989, -0.12, 0.06, 4e-4, -3e-4, -0.01, 0, 0, 0.0]), 6000, 4000
)
WHOLE = np.array([[0.0, 0], [5999, 0], [5999, 3999], [0, 3999]])


def test_formulas_of_lenses_are_copied_with_their_error_stated():
    found = as_opencv(FULL, WHOLE, 8)
    np.testing.assert_array_equal(found.distortion, FULL.params[4:])
    assert found.difference.max_px < 1e-6  # accuracy of the rays
    found = as_opencv(FULL, WHOLE, 4)
    rays = TrueCamera(thin_prism=(0, 0, 0, 0)).rays(FULL.frame_grid(9, 7))
    error = np.linalg.norm(found.project(rays) - FULL.project(rays), axis=1)
    assert 1e-3 < found.difference.rms_px < 1
    assert error.max() == pytest.approx(found.difference.max_px, rel=0.2)  # of another grid
    lens = CameraModel("OPENCV_FISHEYE", np.array([1500.0, 1500, 960, 540, 0.02, -0.01, 0.003, 0]), 1920, 1080)
    found, difference = as_model(lens, np.array([[0.0, 0], [1919, 0], [1919, 1079], [0, 1079]]), "OPENCV_FISHEYE")
    assert difference.max_px < 1e-4
    np.testing.assert_allclose(found.params[:4], lens.params[:4], atol=1e-3)
    with pytest.raises(BadParameter, match="coefficients, not 6"):
        as_opencv(FULL, WHOLE, 6)


EXACT = Difference(0.0, 0.0)
RAYS = np.array([[0.0, 0, 1], [0.3, -0.2, 1], [1.2, 0.9, 1], [-2, 1, 1.5]])
FRAME = np.array([[0.0, 0], [1919, 0], [1919, 1079], [0, 1079]])


def kalibr(model: tuple[str, str], shape: tuple[float, ...], k: tuple[float, ...] = ()) -> np.ndarray:
    return KalibrCamera(model, np.array([*shape, 700.0, 701, 960, 540]), np.array(k), EXACT).project(RAYS)


def test_kalibrs_models_are_those_of_opencv_and_the_best_is_taken():
    K, k = np.array([[700.0, 0, 960], [0, 701, 540], [0, 0, 1]]), (-0.1, 0.02, 1e-3, -2e-3)
    none, given = np.zeros(3), RAYS[:, None]
    omni = cv2.omnidir.projectPoints(given, none, none, K, 0.8, np.array([k]))[0]
    np.testing.assert_allclose(kalibr(("omni", "radtan"), (0.8,), k), omni.reshape(-1, 2), atol=1e-6)
    fisheye = cv2.fisheye.projectPoints(given, none, none, K, np.array(k))[0]
    np.testing.assert_allclose(kalibr(("pinhole", "equidistant"), (), k), fisheye.reshape(-1, 2), atol=1e-6)
    # a double sphere of distance 0 is the extended unified one of beta 1, and that is the unified one: Usenko 2018
    of_ds, of_eucm = kalibr(("ds", "none"), (0.0, 0.4)), kalibr(("eucm", "none"), (0.4, 1.0))
    np.testing.assert_allclose(of_ds, of_eucm)
    xi = 0.4 / 0.6
    unified = KalibrCamera(("omni", "radtan"), np.array([xi, 700 / 0.6, 701 / 0.6, 960, 540]), np.zeros(4), EXACT)
    np.testing.assert_allclose(unified.project(RAYS), of_eucm)
    lens = CameraModel("OPENCV_FISHEYE", np.array([700.0, 700, 960, 540, 0.02, -0.01, 0.003, 0]), 1920, 1080)
    found = as_kalibr(lens, FRAME)
    assert found.model == ("pinhole", "equidistant")
    assert found.difference.max_px < 1e-4
    unified = CameraModel("OPENCV", np.array([700.0, 700, 960, 540, -0.25, 0.04, 0, 0]), 1920, 1080)
    assert as_kalibr(unified, FRAME).model == ("pinhole", "radtan")
