"""Doubt about the camera model, with lenses that have terms which the model does not have."""

import numpy as np
import pytest

from procedures.geometry.cameras import simple_camera
from procedures.geometry.estimate import GeometryParameters, calibrate_geometry
from procedures.geometry.model_discrepancy import missing_terms
from procedures.geometry.uncertainty import projection_uncertainty

from .simulated_views import CELL_MM, Shoot, TrueCamera, fixed_to_charts, take

NO_PRISM = (0.0, 0.0, 0.0, 0.0)


def calibrated(prism, model="OPENCV"):
    shoot = Shoot(TrueCamera(radial=(-0.12, 0.06, 0.0), thin_prism=prism), noise_px=0.03, every=4)
    taken = take(shoot, np.random.default_rng(3))
    return shoot, taken, calibrate_geometry(taken.views, shoot.camera.size, GeometryParameters(CELL_MM, 0.0, model),
                                            taken.nodes).result()  # fmt: skip


@pytest.fixture(scope="module")
def of_prism():
    return calibrated((9e-4, 0.0, -9e-4, 0.0))


@pytest.mark.parametrize(("axis", "name"), [(0, "cx"), (1, "cy")])
def test_the_principal_point_carries_the_doubt_about_a_prism(of_prism, axis, name):
    shoot, _, found = of_prism
    number, fit = found.numbers()[name], found.adjustment
    error, i = abs(number.value - shoot.camera.centre[axis]), found.camera.names.index(name)
    assert error > 5 * fit.scale * fit.covariance[i, i] ** 0.5  # by noise alone it would be impossible
    assert error < 2.5 * number.uncertainty


@pytest.mark.parametrize("distance", [700.0, np.inf])
def test_the_projection_carries_the_doubt_only_as_far_as_the_data_leave_it(of_prism, distance):
    shoot, taken, found = of_prism
    pixels = found.camera.frame_grid(9, 7)[16:-16]
    error = fixed_to_charts(found.camera, [one.pose for one in found.views], taken, shoot.camera, pixels, distance)
    z = np.linalg.norm(error - pixels, axis=1) / projection_uncertainty(found.adjustment, pixels, distance)
    # one draw, whose errors over the frame are correlated: about three are independent
    assert 0.2 < np.sqrt(np.mean(z**2)) < 1.8


def test_a_lens_without_prism_keeps_its_precision():
    _, _, found = calibrated(NO_PRISM)
    pixels = found.camera.frame_grid(9, 7)[16:-16]
    noise, stated = (projection_uncertainty(found.adjustment, pixels, 700.0, noise_only=one) for one in (True, False))
    assert np.sqrt(np.mean(stated**2)) < 1.3 * np.sqrt(np.mean(noise**2))
    pixels = np.array([[0.0, 0.0], [3000.0, 2000.0]])
    counts = {
        model: missing_terms(simple_camera(model, (3000.0, 3000.0), (2000.0, 1500.0), (4000, 3000)), pixels).shape[-1]
        for model in ("SIMPLE_RADIAL", "OPENCV", "THIN_PRISM_FISHEYE", "OPENCV+SPLINE_8X6")
    }
    assert counts == {"SIMPLE_RADIAL": 11, "OPENCV": 10, "THIN_PRISM_FISHEYE": 10, "OPENCV+SPLINE_8X6": 0}
