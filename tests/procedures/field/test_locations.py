import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from procedures.field.measuring import Location, chosen_locations, pan_tilt_deg, rail_mm
from procedures.numerics.scattered import monomials
from procedures.outcome import BadParameter

SHAPE = (1000, 1500)
CENTRE = (np.array(SHAPE[::-1]) - 1) / 2
F_PX = 8500.0
AHEAD = np.array([0.0, 0.0, 1.0])


def chosen(n):
    return np.array([(one.x, one.y) for one in chosen_locations(n)])


@pytest.mark.parametrize("n", [6, 7, 9, 10, 14, 15, 17, 25])
def test_chosen_places_are_distinct_and_determine_a_surface(n):
    points = chosen(n)
    # a square's n places are 1 / sqrt(n) apart on average; nearer than half of that, two repeat one measurement
    apart = np.hypot(*(points[:, None] - points).T) + np.eye(n)
    assert apart.min() > 0.5 / np.sqrt(n)
    assert np.linalg.cond(monomials(2 * points - 1, 2)) < 10


def test_chosen_places_determine_a_quartic_and_are_visited_in_bands():
    bands = chosen(9).reshape(3, 3, 2)
    assert bands[0, :, 1].max() <= bands[1, :, 1].min()
    assert [np.sign(band[-1, 0] - band[0, 0]) for band in bands] == [1, -1, 1]
    grid = np.array([(x, y) for x in np.linspace(-1, 1, 5) for y in np.linspace(-1, 1, 3)])
    assert np.linalg.matrix_rank(monomials(grid, 4)) < 15
    V = monomials(2 * chosen(15) - 1, 4)
    assert np.linalg.slogdet(V.T @ V)[1] > 0


@pytest.mark.parametrize("location", [Location(0.2, 0.7), Location(0.85, 0.15), Location(0.5, 0.5)])
def test_pan_and_tilt_bring_the_axis_to_the_place(location):
    pan, tilt = pan_tilt_deg(location, SHAPE, F_PX, AHEAD)
    seen = Rotation.from_euler("YX", [pan, tilt], degrees=True).inv().apply(AHEAD)
    np.testing.assert_allclose(F_PX * seen[:2] / seen[2] + CENTRE, location.in_pixels(SHAPE), atol=1e-9)


def test_a_rail_brings_the_axis_to_the_place_and_fewer_than_three_are_refused():
    location = Location(0.2, 0.7)
    right, down = rail_mm(location, SHAPE, F_PX, 1200.0)
    image = F_PX * np.array([-right, -down]) / 1200.0 + CENTRE
    np.testing.assert_allclose(image, location.in_pixels(SHAPE), atol=1e-9)
    with pytest.raises(BadParameter, match="three places"):
        chosen_locations(2)
