"""A picture refocused: convolution where the scene is flat, nothing over what is nearer, sharp in focus."""

import math

import numpy as np
import pytest
from scipy.signal import oaconvolve

from procedures import BadParameter, CameraSetting, refocus
from procedures.restoration.masks.blur_models import mask_stack, pillbox, polygon

SETTING = CameraSetting(50, 2.8, 2000, 6)


def flat(radius, shape):
    return np.full(shape, float(SETTING.distance_mm(radius)) / 1000)


@pytest.mark.parametrize("radius", [0.0, 1.3, -4.0])
def test_flat_scene_is_convolved_with_the_blur_circle(radius):
    sharp = np.random.default_rng(0).uniform(0, 1, (2, 60, 70))
    result = refocus(sharp, flat(radius, (60, 70)), SETTING, pillbox())
    expected = sharp
    if radius:
        kernel = mask_stack(pillbox(), abs(radius), R=6).at(abs(radius))
        expected = oaconvolve(sharp, kernel[None], mode="same", axes=(1, 2))
    error = (result.picture - expected)[:, 8:-8, 8:-8]
    assert error.std() < 0.1 * max(expected.std(), 1e-9)  # noise of the sampled aperture on white noise
    assert abs(error.mean()) < 1e-4


def test_polygon_in_front_and_behind_are_mirror_images():
    point = np.zeros((1, 31, 31))
    point[0, 15, 15] = 1
    front, behind = (refocus(point, flat(r, (31, 31)), SETTING, polygon(3)).picture[0] for r in (5.0, -5.0))
    np.testing.assert_allclose(front, behind[::-1, ::-1], atol=1.5 / np.count_nonzero(front > 0))


def test_blur_spreads_over_what_is_behind_and_not_over_what_is_sharp_in_front():
    def half_bright(half, radius):
        sharp, metres = np.zeros((1, 40, 60)), flat(0.0, (40, 60))
        sharp[..., half], metres[:, half] = 1.0, float(SETTING.distance_mm(radius)) / 1000
        return refocus(sharp, metres, SETTING, pillbox()).picture[0]

    behind, row = half_bright(slice(30, None), -5.0), half_bright(slice(30), 5.0)[20]
    assert behind[:, :30].max() == 0.0  # the edge in front stays sharp
    assert behind[:, 30:].min() == pytest.approx(1.0)  # nothing dark spreads behind it
    beyond = (math.acos(0.3) - 0.3 * math.sqrt(1 - 0.3**2)) / math.pi  # of a disc of radius 5, a chord at 1.5
    assert row[31] == pytest.approx(beyond, abs=0.01)
    assert row[36:].max() == 0.0


def test_depth_of_field_ends_where_the_circle_is_a_pixel_wide_and_too_wide_ones_are_refused():
    result = refocus(np.zeros((1, 4, 4)), flat(0.0, (4, 4)), SETTING, pillbox())
    for name, radius in (("depth_of_field_near", 0.5), ("depth_of_field_far", -0.5)):
        assert float(SETTING.blur_radius_px(1000 * result.numbers[name].value)) == pytest.approx(radius)
    # hyperfocal distance f^2 / (N c) of a circle one pixel wide: l_s = H gives a far limit at infinity
    hyperfocal = CameraSetting(50, 2.8, 50**2 / (2.8 * 0.006) + 50, 6)
    assert "depth_of_field_far" not in refocus(np.zeros((1, 4, 4)), flat(0.0, (4, 4)), hyperfocal, pillbox()).numbers
    with pytest.raises(BadParameter, match="blur circles"):
        refocus(np.zeros((1, 4, 4)), flat(80.0, (4, 4)), SETTING, pillbox())
