import numpy as np
import pytest

from .velocity_field import Exposure, Motion, curve

T = np.linspace(0, 0.1, 200)
STILL = np.zeros((200, 3))


def test_a_motion_draws_the_curves_of_its_velocity_field():
    # (5.1) with rotation and T_z zero: velocity -T / l
    velocity = np.tile([0.02, -0.01, 0.0], (200, 1))
    path = curve(Motion(T, velocity, STILL), 0.1, 0.05, 2.0)
    np.testing.assert_allclose(path[-1] - path[0], [-0.02 * 0.1 / 2, 0.01 * 0.1 / 2], rtol=1e-9)
    turning = Motion(T, STILL, np.tile([0.1, -0.2, 0.3], (200, 1)))
    np.testing.assert_allclose(curve(turning, 0.2, -0.1, 1.0), curve(turning, 0.2, -0.1, 50.0), atol=1e-15)
    rolling = Motion(T, STILL, np.tile([0.0, 0.0, 2.0], (200, 1)))
    path = curve(rolling, 0.3, 0.0, 1.0)
    np.testing.assert_allclose(np.hypot(*path.T), 0.3, rtol=1e-6)  # midpoint rule, 512 steps
    assert np.ptp(np.arctan2(path[:, 1], path[:, 0])) == pytest.approx(0.2, rel=1e-3)
    ahead = Motion(T, np.tile([0.0, 0.0, 0.5], (200, 1)), STILL)
    path = curve(ahead, 0.2, 0.1, 2.0)
    # the point is fixed in space: (x l) is constant
    depth = 2.0 - (T[-1] / 2 - 0) * 0.5
    np.testing.assert_allclose(path[-1] * depth, [0.4, 0.2], rtol=1e-3)
    # uniform sideways motion, depth known at the start: a second exposure starts displaced by the shift over the depth
    velocity = np.tile([0.02, 0.0, 0.0], (200, 1))
    record = Motion(T, velocity, STILL)
    later = Exposure(0.06, 0.08, reference_s=0.0)
    path = curve(record, 0.1, 0.05, 2.0, exposure=later)
    # 512 instants: the ends are located to one of them
    instant = 0.02 * (T[-1] / 511) / 2
    assert path[0, 0] == pytest.approx(0.1 - 0.02 * 0.06 / 2, abs=instant)
    assert path[-1, 0] == pytest.approx(0.1 - 0.02 * 0.08 / 2, abs=instant)
