import numpy as np
import pytest

from simulators.world.motion import travel_line
from simulators.world.world import GRAVITY_M_S2, SinusoidalDrive, World


@pytest.fixture
def world() -> World:
    return World()


def test_at_rest_an_imu_feels_gravity_alone(world):
    force, rate = world.ideal_imu(np.array([0.0, 10.0]))
    np.testing.assert_allclose(force, [[0, GRAVITY_M_S2, 0]] * 2)
    assert np.all(rate == 0)


def test_the_bench_rings_after_a_move_and_comes_to_rest(world):
    end_s = travel_line([world.axes["x_mm"]], [250.0], 0.0, 50.0, 400.0)
    t = end_s + np.linspace(0, 0.2, 200)
    # the slowest mode, 9 Hz at 5 %, falls by exp(-2.8) in a second; x_mm, 11 Hz at 4 %, the same
    assert np.ptp(world.pose(t).pan_deg) > 10 * np.ptp(world.pose(t + 1.0).pan_deg) > 0


@pytest.mark.slow
def test_acceleration_integrates_to_the_change_of_velocity(world):
    # from rest to steady speed the integral of the felt force along x is the speed, once the ringing has gone
    travel_line([world.axes["x_mm"]], [300.0], 0.0, 20.0, 400.0)
    t = np.concatenate([np.linspace(-0.1, 0.2, 3001), np.linspace(0.2, 6.0, 5801)[1:]])
    force, _ = world.ideal_imu(t)
    gained = np.trapezoid(force[:, 0], t) * 1000
    # trapezoid rule across two jumps of 0.4 m/s^2: 2 * 400 * 1e-4 mm/s; ringing after 6 s: 1e-6
    assert gained == pytest.approx(20.0, abs=0.08)


def test_light_follows_the_lamp(world):
    world.set_lamp(0.5, 10.0)
    assert world.lamp(9.0) == pytest.approx(1.0)
    assert world.lamp(10.0) == pytest.approx(0.5 * 1.05)
    assert world.lamp(10_000.0) == pytest.approx(0.5)


def test_a_warm_rail_is_longer(world):
    near = world.distance_mm(0.0)
    grown = (world.distance_mm(7200.0) - near) / world.axes["z_mm"].position(0.0)
    assert grown == pytest.approx(23e-6 * (world.temperature_c(7200.0) - world.temperature_c(0.0)), rel=1e-9)


def test_a_shaker_moves_the_camera_from_when_to_when_it_runs():
    world = World()
    rest_mm = world.pose(np.zeros(1)).x_mm[0]
    world.drive((SinusoidalDrive("x_mm", 2.0, 10.0),), 1.0)
    world.drive((), 3.0)
    t_s = np.array([0.9, 1.0, 1.05, 1.5, 3.1])
    # cos(20 pi t): crests at whole tenths of a second, troughs half a period later
    np.testing.assert_allclose(world.pose(t_s).x_mm - rest_mm, [0, 2, -2, 2, 0], atol=1e-9)
    force, _ = world.ideal_imu(t_s)
    # the sway turns the head by 2 / 400, which takes the square of that, halved, from the force along its x
    np.testing.assert_allclose(force[:, 0], np.array([0, -2, 2, -2, 0]) * 1e-3 * (20 * np.pi) ** 2, rtol=1.3e-5)


def test_gravity_is_felt_along_the_unit_as_it_is_turned():
    world = World()
    world.drive((SinusoidalDrive("roll_deg", 2.0, 5.0),), 0.0)
    force, rate = world.ideal_imu(np.array([0.0, 0.05]))
    # rolled clockwise, the unit's x points down: it feels less of what holds it up
    np.testing.assert_allclose(force[0], GRAVITY_M_S2 * np.array([-np.sin(np.radians(2)), np.cos(np.radians(2)), 0]))
    # a quarter of a period later it turns fastest, back: anticlockwise, which is positive about the axis to the back
    np.testing.assert_allclose(rate[1], [0, 0, np.radians(2.0) * 2 * np.pi * 5], rtol=1e-5, atol=1e-9)


def test_a_camera_that_looks_to_the_right_turns_negative_about_its_upward_axis():
    world = World()
    world.drive(
        (SinusoidalDrive("pan_deg", 1.0, 5.0, -np.pi / 2), SinusoidalDrive("tilt_deg", 1.0, 5.0, -np.pi / 2)), 0.0
    )
    _, rate = world.ideal_imu(np.array([1.0]))
    fastest = np.radians(1.0) * 2 * np.pi * 5
    np.testing.assert_allclose(rate[0], [fastest, -fastest, 0], rtol=1e-4, atol=1e-4)
