"""Spline cameras: derivatives, polynomials, and a lens with waves."""

import numpy as np
import pytest

from procedures.geometry.cameras import CameraModel, parameter_names
from procedures.geometry.spline_camera import SplineCamera, spline_models
from procedures.outcome import BadParameter

BASE = CameraModel("OPENCV", np.array([900.0, 910, 322, 238, -0.1, 0.02, 1e-3, -5e-4]), 640, 480)
PLAIN = SplineCamera.over(BASE, "OPENCV+SPLINE_7X5")


def test_a_spline_camera_agrees_with_its_formula_planes_differences_and_rays(rng):
    points = rng.uniform([-0.3, -0.2, 0.9], [0.3, 0.2, 1.1], (40, 3))
    bent = PLAIN.with_params(np.concatenate([BASE.params, rng.standard_normal(70)]))
    np.testing.assert_array_equal(PLAIN.project(points), BASE.project(points))
    assert PLAIN.names[:8] == BASE.names
    assert (PLAIN.names[8], PLAIN.names[-1], len(PLAIN.names)) == ("spline_x_0_0", "spline_y_6_4", 78)
    # a cubic B-spline keeps polynomials of the first degree: its control points lie a piece apart, from -1
    i, j = np.meshgrid(np.arange(7) - 1, np.arange(5) - 1)
    field = np.stack([1 + 2 * i - j, 0.5 * i + 3 * j], axis=-1)
    camera = PLAIN.with_params(np.concatenate([BASE.params, field.ravel()]))
    places = BASE.frame_grid(9, 7)
    u, v = (places / [639, 479] * [4, 2]).T
    np.testing.assert_allclose(camera.correction(places), np.column_stack([1 + 2 * u - v, 0.5 * u + 3 * v]), atol=1e-12)
    steps = np.where(np.array(bent.units) == "pixel", 1e-3, 1e-7)
    for i in (0, 2, 4, 7, 8, 30, 77):
        step = steps[i] * np.eye(len(bent.params))[i]
        more, less = (bent.with_params(bent.params + sign * step).project(points) for sign in (1, -1))
        change = more - less
        np.testing.assert_allclose(bent.by_params(points)[..., i], change / (2 * steps[i]), rtol=1e-5, atol=1e-5)
    for i, axis in enumerate(1e-6 * np.eye(3)):
        change = bent.project(points + axis) - bent.project(points - axis)
        np.testing.assert_allclose(bent.by_points(points)[..., i], change / 2e-6, rtol=1e-5, atol=1e-3)
    pixels = BASE.frame_grid(8, 6)
    np.testing.assert_allclose(bent.project(bent.rays(pixels)), pixels, atol=1e-6)
    assert np.isnan(bent.project(np.array([[0.1, 0.1, -1.0]]))).all()
    assert spline_models("OPENCV", 6000, 4000) == ("OPENCV+SPLINE_12X9", "OPENCV+SPLINE_18X13")
    assert spline_models("OPENCV", 400, 4000)[0] == "OPENCV+SPLINE_4X12"


@pytest.mark.parametrize(
    "model", ["OPENCV+SPLINE_3X9", "BROWN+SPLINE_8X8", "OPENCV+SPLINE_8", "OPENCV+SPLINE_", "OPENCV+"]
)
def test_an_invalid_grid_is_refused(model):
    with pytest.raises(BadParameter, match="no camera model"):
        parameter_names(model)
