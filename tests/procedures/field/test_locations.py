from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from procedures.field.locations import Location, chosen_locations, grid_locations, pan_tilt_deg, rail_mm
from procedures.numerics.scattered import monomials
from procedures.outcome import BadParameter

SHAPE = (1000, 1500)
F_PX = 8500.0


def as_points(locations):
    return np.array([(one.x, one.y) for one in locations])


def test_a_grid_is_walked_without_jumps():
    points = as_points(grid_locations(5, 4))
    steps = np.abs(np.diff(points, axis=0))
    assert len(points) == 20
    assert points.min() == pytest.approx(0.12)
    # one step at a time, along a row or to the next
    assert np.all(np.count_nonzero(steps > 1e-12, axis=1) == 1)


@pytest.mark.parametrize("n", [6, 10, 15, 17])
def test_chosen_places_are_as_many_as_asked_and_determine_a_surface(n):
    points = as_points(chosen_locations(n))
    assert len(np.unique(points.round(6), axis=0)) == n
    design = monomials((points - 0.5) / 0.38, 2)
    assert np.linalg.cond(design) < 10


@pytest.mark.parametrize("n", [7, 9, 14, 25])
def test_no_two_chosen_places_are_nearly_the_same(n):
    # a square's n places are 1 / sqrt(n) apart on average; nearer than half of that, two tell little more than one
    points = (as_points(chosen_locations(n)) - 0.12) / 0.76
    apart = np.hypot(*(points[:, None] - points).T) + np.eye(n)
    assert apart.min() > 0.5 / np.sqrt(n)


def test_fifteen_chosen_places_fix_a_quartic_better_than_a_grid():
    # the determinant of the normal equations is what they are chosen by
    def information(locations):
        return np.linalg.slogdet(monomials((as_points(locations) - 0.5) / 0.38, 4).T
                                 @ monomials((as_points(locations) - 0.5) / 0.38, 4))[1]  # fmt: skip

    grid = as_points(grid_locations(5, 3))
    assert np.linalg.matrix_rank(monomials((grid - 0.5) / 0.38, 4)) < 15
    assert information(chosen_locations(15)) > 0


@pytest.mark.parametrize("location", [Location(0.2, 0.7), Location(0.85, 0.15), Location(0.5, 0.5)])
def test_pan_and_tilt_bring_the_axis_to_the_place(location):
    pan, tilt = pan_tilt_deg(location, SHAPE, F_PX)
    seen = Rotation.from_euler("YX", [pan, tilt], degrees=True).inv().apply([0, 0, 1.0])
    x, y = location.in_pixels(SHAPE)
    found = F_PX * seen[:2] / seen[2] + np.array([SHAPE[1] - 1, SHAPE[0] - 1]) / 2
    np.testing.assert_allclose(found, [x, y], atol=1e-9)


def test_a_rail_brings_the_axis_to_the_place():
    location = Location(0.2, 0.7)
    right, down = rail_mm(location, SHAPE, F_PX, 1200.0)
    found = F_PX * np.array([-right, -down]) / 1200.0 + np.array([SHAPE[1] - 1, SHAPE[0] - 1]) / 2
    np.testing.assert_allclose(found, location.in_pixels(SHAPE), atol=1e-9)


def test_plans_that_cannot_be_meant_are_refused():
    with pytest.raises(BadParameter, match=r"margin 0\.6"):
        grid_locations(5, 5, 0.6)
    with pytest.raises(BadParameter, match="three places"):
        chosen_locations(2)
