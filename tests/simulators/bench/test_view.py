"""The bench's camera sees the bench: where the stage put it, how it shook meanwhile, how bright the lamp was."""

from dataclasses import replace

import numpy as np
import pytest

from procedures.raw import read_frame
from simulators.bench.body import Opening
from simulators.bench.view import SensorMount, View, bench_camera, instants
from simulators.camera.sensor import Sensor
from simulators.world.motion import travel_line
from simulators.world.world import World

SLOW_FIXTURES = {"view"}

CELL_CENTRE = np.array([[128.0, 128.0]])


@pytest.fixture
def world():
    return World()


@pytest.fixture
def view(world, rng):
    return View(world, rng, replace(bench_camera(), sensor=Sensor(rows=320, columns=400)))


def centre(view, taken):
    """Where the chart's centre truly is in G1, (x, y)."""
    return taken.true_points("G1", CELL_CENTRE)[0]


def test_its_frames_are_read_back(view, tmp_path):
    path = tmp_path / "frame.dng"
    path.write_bytes(view.develop(Opening(0.0, 0.02, 1)))
    frame = read_frame(path)
    assert frame.exposure.exposure_s == pytest.approx(0.02)
    np.testing.assert_allclose(frame.planes["G1"].samples, view.taken[0].plane("G1"), atol=1e-6)


def test_noise_of_a_frame_follows_from_its_number_alone(world, view):
    again = View(world, np.random.default_rng(20120323), view.camera)
    one, two = (view.photograph(Opening(0.0, 0.02, number)).plane("G1") for number in (1, 2))
    np.testing.assert_array_equal(again.photograph(Opening(0.0, 0.02, 2)).plane("G1"), two)
    assert np.any(one != two)


def test_half_a_frame_is_not_read(view, tmp_path):
    from station.bench.opening import inspect_raw

    path = tmp_path / "half.dng"
    data = view.develop(Opening(0.0, 0.02, 1))
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(Exception, match=r"truncated|damaged|cannot"):
        inspect_raw(path)
    path.write_bytes(data)
    assert inspect_raw(path).iso == 100


def test_moving_right_moves_the_chart_left_by_f_over_distance(view, world):
    before = centre(view, view.photograph(Opening(0.0, 0.02, 1)))
    end_s = travel_line([world.axes["x_mm"]], [world.axes["x_mm"].position(0.0) + 10.0], 1.0, 20.0, 200.0)
    after = centre(view, view.photograph(Opening(end_s + 30.0, 0.02, 2)))
    # thin lens: image distance / object distance; G1 has every second pixel; thermal growth of the rail is 1e-6 of it
    z_mm = 1550.0
    image_mm = 24.0 * z_mm / (z_mm - 24.0)
    assert after[0] - before[0] == pytest.approx(-10.0 * image_mm / z_mm / 0.00594 / 2, rel=1e-4)
    assert after[1] - before[1] == pytest.approx(0.0, abs=1e-3)


def test_panning_right_moves_the_chart_left(view, world):
    travel_line([world.axes["pan_deg"]], [1.0], 1.0, 5.0, 20.0)
    moved = centre(view, view.photograph(Opening(60.0, 0.02, 1)))
    travel_line([world.axes["pan_deg"]], [0.0], 70.0, 5.0, 20.0)
    still = centre(view, view.photograph(Opening(130.0, 0.02, 2)))
    # tan(1 deg) times the principal distance, 24.38 mm; plus distortion-free pinhole
    assert moved[0] - still[0] == pytest.approx(-np.tan(np.radians(1.0)) * 24.377 / 0.00594 / 2, rel=1e-3)


def test_nearer_is_larger(view, world):
    far = view.photograph(Opening(0.0, 0.02, 1)).pixels_per_pattern("G1")
    travel_line([world.axes["z_mm"]], [650.0], 1.0, 50.0, 200.0)
    near = view.photograph(Opening(100.0, 0.02, 2)).pixels_per_pattern("G1")
    assert near / far == pytest.approx((1550.0 / 24 - 1) / (1450.0 / 24 - 1), rel=1e-3)


def test_an_exposure_during_ring_down_is_blurred_by_the_path_the_camera_took(view, world):
    end_s = travel_line([world.axes["x_mm"]], [200.0], 0.0, 50.0, 400.0)
    shaken = view.photograph(Opening(end_s, 0.1, 1)).true_psf("G1", 4, 17)
    still = view.photograph(Opening(end_s + 60.0, 0.1, 2)).true_psf("G1", 4, 17)
    columns = np.arange(17) - 8

    def spread(psf):
        across = psf.h.sum(axis=0)
        mean = np.sum(columns * across)
        return np.sum((columns - mean) ** 2 * across)

    centres, _ = view.chart_pose(world.pose(instants(Opening(end_s, 0.1, 1))))
    path_px = 24.377 / 0.00594 * centres[:, 0] / centres[:, 2]
    # variances add; PSF samples are a quarter of a G1 pixel, which is two sensor pixels; 17 samples cut the tails
    assert spread(shaken) - spread(still) == pytest.approx(np.var(path_px) / 0.25, rel=0.15)


def test_light_temperature_and_tilt_are_seen_in_the_frame(view, world, rng):
    bright = view.photograph(Opening(0.0, 0.02, 1)).plane("G1").mean()
    world.set_lamp(0.5, 1.0)
    dim = view.photograph(Opening(5000.0, 0.02, 2)).plane("G1").mean()
    # 32000 pixels: the noise of the mean is far below a percent
    assert dim / bright == pytest.approx(0.5, rel=0.01)
    view = View(world, rng, focus_mm=1550.0)
    warm_s = 3 * world.room.warming_s
    drift = view._focus_mm(warm_s, 0.0) - view._focus_mm(0.0, 0.0)
    assert drift == pytest.approx(-1.5 * (world.temperature_c(warm_s) - world.temperature_c(0.0)))
    # of four screws 10 mm out, seen from behind the right one is where the photograph's left falls
    held = SensorMount(count=4, radius_mm=10.0, pitch_mm=0.5, first_deg=0.0).turned((0.0, 0.1, 0.0, -0.1))
    assert held.slopes == pytest.approx((-5.0, 0.0))  # 50 um over 10 mm, away from the lens at the photograph's left
    # path differences of rms a um are those of a sensor 16 sqrt(3) N^2 a um behind the image
    camera = replace(bench_camera(), sensor=Sensor(rows=300, columns=400), pitch_um=10.0)
    per_rms = 16 * 3**0.5 * camera.lens.f_number**2
    # 500 pixels of 10 um across: 2.5 mm to a corner
    assert SensorMount(slopes=(4.0, -2.0)).tilt_um(camera) == pytest.approx((10 / per_rms, -5 / per_rms))
