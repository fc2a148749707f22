from __future__ import annotations

import numpy as np
import pytest

from procedures.outcome import BadInput
from procedures.restoration.masks import motion as m

T = np.linspace(0, 0.1, 200)
STILL = np.zeros((200, 3))


def test_translation_draws_minus_its_path_over_the_depth():
    # (5.1) with rotation and T_z zero: velocity -T / l
    velocity = np.tile([0.02, -0.01, 0.0], (200, 1))
    drawn = m.curve(m.Motion(T, velocity, STILL), 0.1, 0.05, 2.0)
    np.testing.assert_allclose(drawn[-1] - drawn[0], [-0.02 * 0.1 / 2, 0.01 * 0.1 / 2], rtol=1e-9)


def test_rotation_does_not_ask_for_the_depth():
    turning = m.Motion(T, STILL, np.tile([0.1, -0.2, 0.3], (200, 1)))
    np.testing.assert_allclose(m.curve(turning, 0.2, -0.1, 1.0), m.curve(turning, 0.2, -0.1, 50.0), atol=1e-15)


def test_rolling_draws_circles_about_the_centre():
    rolling = m.Motion(T, STILL, np.tile([0.0, 0.0, 2.0], (200, 1)))
    drawn = m.curve(rolling, 0.3, 0.0, 1.0)
    np.testing.assert_allclose(np.hypot(*drawn.T), 0.3, rtol=1e-6)  # midpoint rule, 512 steps
    assert np.ptp(np.arctan2(drawn[:, 1], drawn[:, 0])) == pytest.approx(0.2, rel=1e-3)


def test_moving_ahead_scales_the_image():
    ahead = m.Motion(T, np.tile([0.0, 0.0, 0.5], (200, 1)), STILL)
    drawn = m.curve(ahead, 0.2, 0.1, 2.0)
    # the point keeps its place in space: (x l) is constant
    depth = 2.0 - (T[-1] / 2 - 0) * 0.5
    np.testing.assert_allclose(drawn[-1] * depth, [0.4, 0.2], rtol=1e-3)


def test_masks_of_a_path_keep_light_and_its_mean():
    path = np.stack([np.linspace(-2.5, 3.0, 500), np.zeros(500)], axis=1)
    mask = m.path_mask(path, 5)
    assert mask.sum() == pytest.approx(1)
    assert (mask * np.arange(-5, 6)).sum() == pytest.approx(0.25, abs=1e-6)


def test_motion_that_leaves_the_masks_is_refused():
    with pytest.raises(BadInput, match="leaves masks"):
        m.path_mask(np.array([[0.0, 0.0], [9.0, 0.0]]), 5)


def test_a_record_that_is_none_is_refused():
    with pytest.raises(BadInput, match="two samples"):
        m.Motion(T[:1], STILL[:1], STILL[:1])
    with pytest.raises(BadInput, match="increase"):
        m.Motion(T[::-1], STILL, STILL)


def test_a_later_exposure_is_drawn_where_it_has_gone():
    # steady sideways motion, depth known at the start: a second exposure begins its displacement over the depth away
    velocity = np.tile([0.02, 0.0, 0.0], (200, 1))
    record = m.Motion(T, velocity, STILL)
    later = m.Exposure(0.06, 0.08, reference_s=0.0)
    drawn = m.curve(record, 0.1, 0.05, 2.0, exposure=later)
    # 512 instants: the ends are placed to one of them
    instant = 0.02 * (T[-1] / 511) / 2
    assert drawn[0, 0] == pytest.approx(0.1 - 0.02 * 0.06 / 2, abs=instant)
    assert drawn[-1, 0] == pytest.approx(0.1 - 0.02 * 0.08 / 2, abs=instant)
