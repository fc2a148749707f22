from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulators.raster import coverage, outline

ROUNDING = 1e-11
coordinates = st.floats(-3.0, 12.0, allow_nan=False)


def polygon_area(vertices: np.ndarray) -> float:
    x, y = vertices.T
    return abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))) / 2


@given(st.tuples(coordinates, coordinates), st.floats(0.05, 4.0), st.floats(0.0, 7.0), st.integers(3, 9))
def test_the_cells_of_a_polygon_inside_the_grid_sum_to_its_area(centre, radius, turn, corners):
    angles = turn + np.arange(corners) * 2 * np.pi / corners
    vertices = 10 + np.array(centre) + radius * np.column_stack([np.cos(angles), np.sin(angles)])
    cells = coverage(outline(vertices), (30, 30))
    assert cells.sum() == pytest.approx(polygon_area(vertices), abs=ROUNDING)
    assert cells.min() > -ROUNDING
    assert cells.max() < 1 + ROUNDING


def test_a_rectangle_covers_its_cells_in_proportion():
    cells = coverage(outline(np.array([[0.25, 1.0], [2.5, 1.0], [2.5, 2.5], [0.25, 2.5]])), (4, 4))
    np.testing.assert_allclose(cells[1], [0.75, 1, 0.5, 0], atol=ROUNDING)
    np.testing.assert_allclose(cells[2], [0.375, 0.5, 0.25, 0], atol=ROUNDING)
    np.testing.assert_allclose(cells[[0, 3]], 0, atol=ROUNDING)


def test_a_diagonal_halves_the_cells_it_crosses():
    cells = coverage(outline(np.array([[0.0, 0.0], [5.0, 5.0], [0.0, 5.0]])), (5, 5))
    np.testing.assert_allclose(cells, np.tril(np.ones((5, 5)), -1) + 0.5 * np.eye(5), atol=ROUNDING)


@given(st.lists(st.tuples(coordinates, coordinates), min_size=3, max_size=3))
def test_a_part_of_the_grid_shows_a_part_of_the_picture(corners):
    vertices = np.array(corners)
    whole = coverage(outline(vertices + 4), (20, 20))
    part = coverage(outline(vertices + 4 - np.array([6, 5])), (8, 7))
    np.testing.assert_allclose(part, whole[5:13, 6:13], atol=ROUNDING)


def test_the_direction_of_walking_round_does_not_matter():
    vertices = np.array([[1.3, 0.2], [6.1, 2.2], [3.3, 5.7]])
    np.testing.assert_allclose(
        coverage(outline(vertices), (7, 7)), coverage(outline(vertices[::-1]), (7, 7)), atol=ROUNDING
    )
