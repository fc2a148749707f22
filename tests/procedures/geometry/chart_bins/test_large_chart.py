import numpy as np
import pytest

from procedures import Chart, Plane, view_of
from procedures.geometry.chart_bins.large_chart import enlarged, reduced
from procedures.geometry.chart_bins.turned_view import shrunk
from procedures.pattern_psf.correspondences import Correspondences, bin_centres
from simulators.camera.camera import Lens, SimulatedCamera
from simulators.camera.optics import Optics
from simulators.camera.sensor import Sensor
from simulators.world.scene import Scene

CHART, WHITE_E, PITCH_UM = Chart.from_seed(), 1e4, 7.52


def test_reduced_pixels_have_the_centres_that_enlarging_assumes():
    y, x = np.mgrid[:11, :14].astype(np.float32)
    small = reduced(3 * x + 5 * y, 3)
    assert small.shape == (3, 4)
    bins = Correspondences(np.array([0]), np.array([[2.0, 1.0]]), np.eye(2)[None])
    (px, py), covariance = enlarged(bins, 3).points[0], enlarged(bins, 3).covariance[0]
    assert small[1, 2] == pytest.approx(3 * px + 5 * py)  # the mean of a plane is its central value
    np.testing.assert_array_equal(covariance, 9 * np.eye(2))
    np.testing.assert_allclose(shrunk(np.array([[px, py]]), 3), bins.points)


@pytest.mark.nightly
@pytest.mark.parametrize(("gaussian_px", "most_px"), [(0.3, 0.02), (2.0, 0.1)])
def test_a_chart_too_large_for_its_psf_is_measured_in_all_pixels(gaussian_px, most_px):
    sensor = Sensor(560, 560, None, bits=16, full_well_e=1.3 * WHITE_E, gain_e_per_dn=1.3 * WHITE_E / 65000)
    optics = Optics.typical(f_number=5.6, pitch_um=PITCH_UM, gaussian_px=gaussian_px)
    lens = Lens(k1=-0.04, k2=0.01, focal_length_mm=12.0)
    camera = SimulatedCamera(lens, sensor, PITCH_UM, optics, white_e_per_s=WHITE_E / 0.02, focus_mm=700.0)
    placed = camera.place(CHART, pixels=380.0, yaw_deg=20, pitch_deg=10, roll_deg=95)
    shot = camera.photograph(Scene((placed,)), np.random.default_rng(1))
    view = view_of(Plane("Y", shot.plane("Y").astype(np.float32), 1 / 65535), CHART, "large").value
    assert view is not None
    assert len(view) > 560
    error = view.points - shot.true_points("Y", bin_centres()[view.index])
    error = error - error.mean(axis=0)  # the centre of the blur, absorbed by the pose
    sigma = np.sqrt(np.einsum("naa->na", view.covariance))
    assert sigma.max() < most_px
    # 576 bins: 3 %; errors of the Gaussian blur are in the residual from which the covariance derives
    np.testing.assert_allclose((error / sigma).std(axis=0), 1, atol=0.15)
