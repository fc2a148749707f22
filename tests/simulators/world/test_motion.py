import numpy as np
import pytest

from simulators.world.motion import Axis, Mode, brake_line, travel_line


def test_a_line_ends_at_its_target_and_at_rest():
    x, y = Axis(0, 100, 10.0), Axis(0, 50, 40.0)
    end_s = travel_line([x, y], [70.0, 5.0], 1.0, speed=20.0, acceleration=100.0)
    assert (x.position(end_s + 1), y.position(end_s + 1)) == (70.0, 5.0)
    assert not x.moves(end_s)
    # trapezoid: L/v + v/a
    assert end_s - 1.0 == pytest.approx(np.hypot(60, 35) / 20 + 20 / 100)


@pytest.mark.parametrize("t_s", [0.05, 0.4, 3.1])
def test_velocity_is_the_derivative_of_position(t_s):
    x = Axis(0, 100, 0.0)
    travel_line([x], [60.0], 0.0, speed=20.0, acceleration=100.0)
    h = 1e-6  # rounding 1e-14/h = 1e-8, truncation h * a
    assert (x.position(t_s + h) - x.position(t_s - h)) / (2 * h) == pytest.approx(x.velocity(t_s), abs=1e-6)


def test_modes_ring_down_and_braking_stays_on_its_line():
    x, y = Axis(0, 100, 0.0), Axis(0, 100, 0.0)
    travel_line([x, y], [60.0, 30.0], 0.0, speed=20.0, acceleration=100.0)
    before = x.position(1.0), y.position(1.0)
    rest_s = brake_line([x, y], 1.0, 100.0)
    way = x.position(rest_s) - before[0], y.position(rest_s) - before[1]
    assert way[0] == pytest.approx(2 * way[1])
    assert np.hypot(*way) == pytest.approx(20**2 / (2 * 100))
    mode = Mode("x", 12.0, 0.05, 0.7)
    shocks = [(0.0, 0.0, 100.0), (0.2, 0.0, -100.0), (0.3, 2.0, 0.0)]
    h = 1e-5
    t = np.array([0.1, 0.25, 0.5, 0.9])
    x = [mode.response(shocks, t + k * h)[0] for k in (-1, 0, 1)]
    second = (x[2] - 2 * x[1] + x[0]) / h**2
    # central difference: error h^2/12 x'''' = 1e-10/12 * 0.02 * w^4 under 1e-3, rounding 1e-16 / h^2 under 1e-5
    np.testing.assert_allclose(mode.response(shocks, t)[1], second, atol=2e-3)
    mode = Mode("x", 12.0, 0.05, 1.0)
    x, _ = mode.response([(0.0, 1.0, 0.0)], np.array([mode.lasts_s()]))
    assert abs(x[0]) <= 1e-4 * 1.0 / (2 * np.pi * 12.0)
