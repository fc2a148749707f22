import numpy as np
import pytest

from procedures import Chart, GeometryParameters, Plane, Verdict, calibrate_geometry
from procedures.geometry.chart_bins.photographs import view_of, views_of
from simulators.camera.camera import Lens, SimulatedCamera
from simulators.camera.optics import Optics
from simulators.camera.sensor import Sensor
from simulators.world.scene import Scene

CHART, CELL_MM, WHITE_E, PITCH_UM, FOCUS_MM = Chart.from_seed(), 300 / 320, 2e4, 7.52, 700.0
PLACES = ((0.5, 0.5), (0.34, 0.36), (0.66, 0.36), (0.34, 0.64), (0.66, 0.64), (0.5, 0.35))


def wide_camera(rows: int = 330, columns: int = 420) -> SimulatedCamera:
    """A grey camera with a short lens: the chart fills half of its frame."""
    sensor = Sensor(rows, columns, None, bits=16, full_well_e=1.3 * WHITE_E, gain_e_per_dn=1.3 * WHITE_E / 65000)
    optics = Optics.typical(f_number=5.6, pitch_um=PITCH_UM, gaussian_px=0.3)
    lens = Lens(k1=-0.04, k2=0.01, focal_length_mm=5.0)
    return SimulatedCamera(lens, sensor, PITCH_UM, optics, white_e_per_s=WHITE_E / 0.02, focus_mm=FOCUS_MM)


def tilted(camera: SimulatedCamera, i: int, pixels: float = 150.0):
    around = 2 * np.pi * 0.381966 * i
    yaw, pitch = 28 * np.cos(around), 28 * np.sin(around)
    return camera.place(
        CHART, pixels=pixels, at=PLACES[i], cell_mm=CELL_MM, yaw_deg=yaw, pitch_deg=pitch, roll_deg=90 * i + 5
    )


def photographed(camera: SimulatedCamera, placed, seed: int) -> Plane:
    shot = camera.photograph(Scene((placed,)), np.random.default_rng(seed))
    return Plane("Y", shot.plane("Y").astype(np.float32), 1 / 65535)


@pytest.mark.slow
def test_photographs_give_the_parameters_of_the_camera():
    camera = wide_camera()
    placed = [tilted(camera, i) for i in range(len(PLACES))]
    views = [view_of(photographed(camera, one, i), CHART, f"{i}").value for i, one in enumerate(placed)]
    found = calibrate_geometry(views, (420, 330), GeometryParameters(CELL_MM, model="OPENCV")).value
    assert found is not None
    assert found.residual_scale == pytest.approx(1, abs=0.05)
    numbers, projection = found.numbers(), camera.projection(FOCUS_MM)
    # r (1 + k1 q^2 + k2 q^4) of the simulator, q = r / radius, in OPENCV's r / f
    share = projection.principal_px / projection.radius_px
    truth = {
        "fx": projection.principal_px, "fy": projection.principal_px, "cx": 209.5, "cy": 164.5,
        "k1": -0.04 * share**2, "k2": 0.01 * share**4, "p1": 0.0, "p2": 0.0,
    }  # fmt: skip
    error = np.array([numbers[name].value - value for name, value in truth.items()])
    # chi square of 8 degrees: beyond 26 once in a thousand
    assert error @ np.linalg.solve(found.covariance, error) < 26
    for one, chart in zip(found.views, placed, strict=True):
        assert one.distance.value == pytest.approx(float(np.linalg.norm(chart.pose.centre_mm)), rel=3e-4)


@pytest.mark.slow
def test_a_plane_of_every_second_pixel_is_measured_in_sensor_pixels():
    camera = wide_camera(210, 210)
    plane = photographed(camera, camera.place(CHART, pixels=110.0, cell_mm=CELL_MM, yaw_deg=10), 1)
    grey = view_of(plane, CHART, "grey").value
    green = Plane("G1", plane.samples, plane.quantisation, 2, (1, 0))
    # a plane that begins one of its pixels further left and up: its chart lies further right and down
    moved = Plane("R", np.pad(plane.samples, ((1, 0), (1, 0)), mode="edge"), plane.quantisation, 2, (-1, -2))
    dark = Plane("B", np.zeros_like(plane.samples), plane.quantisation, 2, (0, 1))
    views = views_of({"R": moved, "G1": green, "B": dark}, CHART, "bayer")
    bayer, red = views["G1"].value, views["R"].value
    assert grey is not None
    assert bayer is not None
    assert red is not None
    np.testing.assert_allclose(bayer.points, 2 * grey.points + [1, 0], atol=1e-9)
    np.testing.assert_allclose(bayer.covariance, 4 * grey.covariance, rtol=1e-9)
    np.testing.assert_allclose(red.points, bayer.points, atol=1e-4)
    assert views["B"].verdict is Verdict.REFUSED


def test_planes_without_a_chart_are_all_refused():
    dark = Plane("R", np.zeros((200, 200), np.float32), 1 / 65535)
    views = views_of({"R": dark, "B": dark}, CHART, "dark")
    assert [(name, "no chart in the photograph" in one.reason) for name, one in views.items()] == [
        ("R", True), ("B", True)
    ]  # fmt: skip
