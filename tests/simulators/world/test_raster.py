import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulators.world.projection import coverage, outline

ROUNDING = 1e-11
coordinates = st.floats(-3.0, 12.0, allow_nan=False)


def area_and_centroid(vertices: np.ndarray) -> tuple[float, np.ndarray]:
    x, y = vertices.T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    centroid = [np.sum((a + np.roll(a, -1)) * cross) / (3 * np.sum(cross)) for a in (x, y)]
    return abs(float(np.sum(cross))) / 2, np.array(centroid)


@given(st.tuples(coordinates, coordinates), st.floats(0.05, 4.0), st.floats(0.0, 7.0), st.integers(3, 9))
def test_a_polygon_keeps_its_area_and_its_centroid(centre, radius, turn, corners):
    # hats add up to 1, and to x when weighted by where they stand
    angles = turn + np.arange(corners) * 2 * np.pi / corners
    vertices = 10 + np.array(centre) + radius * np.column_stack([np.cos(angles), np.sin(angles)])
    samples = coverage(outline(vertices), (30, 30))
    area, centroid = area_and_centroid(vertices)
    assert samples.sum() == pytest.approx(area, abs=ROUNDING)
    y, x = np.mgrid[:30, :30]
    moment = [np.sum(samples * x), np.sum(samples * y)]
    np.testing.assert_allclose(moment, centroid * area, atol=100 * ROUNDING)
    assert samples.min() > -ROUNDING
    assert samples.max() < 1 + ROUNDING


def test_a_rectangle_is_seen_through_the_hat():
    def step(edge: float) -> np.ndarray:  # the hat's integral up to each sample from an edge
        t = np.clip(np.arange(6) - edge, -1, 1)
        return np.where(t < 0, (1 + t) ** 2 / 2, 1 - (1 - t) ** 2 / 2)

    samples = coverage(outline(np.array([[0.25, 1.0], [3.5, 1.0], [3.5, 4.2], [0.25, 4.2]])), (6, 6))
    expected = np.outer(step(1.0) - step(4.2), step(0.25) - step(3.5))
    np.testing.assert_allclose(samples, expected, atol=ROUNDING)


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
