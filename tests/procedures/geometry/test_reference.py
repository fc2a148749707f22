"""Places in a photograph and on its chart, and the reference camera with its formulas."""

import numpy as np
import pytest

from procedures.geometry.cameras import simple_camera
from procedures.geometry.chart_bins.bin_kernels import RenderModel, cells_along
from procedures.geometry.estimate import Geometry, GeometryParameters, calibrate_geometry
from procedures.geometry.next_view import chart_at
from procedures.geometry.reference import ROUGHNESS_PX
from procedures.numerics.warps import CubicWarp

from .simulated_views import CELL_MM, Shoot, TrueCamera, apart, take


def test_a_place_in_the_photograph_is_a_place_on_the_chart():
    # through a displacement of all cubics and a homography, in a picture reduced by three
    rng = np.random.default_rng(2)
    H = np.array([[0.4, 0.02, 3], [-0.03, 0.5, 2], [1e-4, -2e-4, 1]])
    warp = CubicWarp(H, np.array([20.0, 15.0]), 30.0, 0.3 * rng.standard_normal((2, 9)))
    look = RenderModel(
        np.zeros((4, 4), np.float32), np.zeros((4, 4)), warp.H, warp.centre, warp.radius, warp.displacement, 3, 0.0,
        1.0, 3, 0.5, np.ones(3),
    )  # fmt: skip
    cells = np.empty((2, 7))
    cells_along(look, 10.0, 31.0, 4.0, cells)
    places = np.column_stack([10.0 + 4.0 * np.arange(7), np.full(7, 31.0)])
    # the middle of a reduced pixel of three is that of its second one
    np.testing.assert_allclose(cells.T, warp.forward((places - 1) / 3), rtol=1e-9)


@pytest.mark.parametrize("at", [(0.0, 0.0), (0.25, 0.75), (1.0, 1.0)])
def test_a_chart_hangs_where_it_is_wanted(at):
    camera = simple_camera("OPENCV", (2000.0, 2000.0), (310.0, 239.5), (640, 480))
    pose = chart_at(camera, at, 30.0, -20.0, 1500.0)
    np.testing.assert_allclose(camera.project(pose.t[None])[0], [at[0] * 639, at[1] * 479], atol=1e-6)
    assert np.linalg.norm(pose.t) == pytest.approx(1500)
    # turned about its upright axis first, then about its own horizontal one
    turn = np.radians([30, -20])
    expected = [np.sin(turn[0]) * np.cos(turn[1]), -np.sin(turn[1]), np.cos(turn[0]) * np.cos(turn[1])]
    np.testing.assert_allclose(pose.R[:, 2], expected, atol=1e-12)


def calibrated(camera: TrueCamera, model: str | None = None) -> Geometry:
    taken = take(Shoot(camera=camera, every=4, count=8), np.random.default_rng(6))
    return calibrate_geometry(taken.views, camera.size, GeometryParameters(CELL_MM, 0.0, model), taken.nodes).result()


def test_a_smooth_lens_has_a_smooth_reference(geometry_of_prism):
    assert geometry_of_prism.camera.roughness_px <= ROUGHNESS_PX[1]
    assert geometry_of_prism.trials[0].residual == min(trial.residual for trial in geometry_of_prism.trials)


@pytest.fixture(scope="module")
def geometry_of_prism() -> Geometry:
    return calibrated(TrueCamera(radial=(-0.12, 0.06, 0.0)))


@pytest.mark.nightly
def test_no_formula_describes_waves_and_the_reference_does():
    of_waves = calibrated(TrueCamera(wave_px=0.3), "STEREOGRAPHIC+SPLINE_12X9")
    # third differences of 0.3 pixel in waves of 4000 pixels, over pieces of 670: 0.3 (2 pi / 6)^3
    assert of_waves.camera.roughness_px >= 0.1
    inner = np.sqrt(np.mean(np.sum(apart(of_waves.camera, TrueCamera(wave_px=0.3), 0.3) ** 2, axis=1)))
    assert inner < min(one.difference.rms_px for one in of_waves.formulas) / 3


def test_formulas_state_their_loss_and_the_simplest_good_one_is_reported(geometry_of_prism):
    fits, truth = {one.camera.model: one for one in geometry_of_prism.formulas}, TrueCamera()
    # 6e-4 r^2 is 0.5 pixel rms over the frame, of which OPENCV's decentring takes a part
    assert 0.05 < fits["OPENCV"].difference.rms_px < 0.5
    assert fits["THIN_PRISM_FISHEYE"].difference.rms_px < 0.02
    for one in fits.values():
        sigma = dict(zip(one.camera.names, np.sqrt(np.diag(one.covariance)), strict=True))
        assert abs(one.camera.centre[0] - truth.centre[0]) < 3 * sigma["cx"]
        assert abs(one.camera.centre[1] - truth.centre[1]) < 3 * sigma["cy"]
    formula = geometry_of_prism.formula
    assert formula.difference.rms_px <= max(geometry_of_prism.noise_px, 0.005)
    number = geometry_of_prism.numbers()["fx"]
    assert formula.camera.model in number.method
    assert number.value == formula.camera.focal_px[0]
    assert abs(number.value - TrueCamera().focal_px[0]) < 3 * number.uncertainty
