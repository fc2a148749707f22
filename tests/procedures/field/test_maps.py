import numpy as np
import pytest

from procedures import Psf, Refused
from procedures.field.maps import MAPS, derive, grid, lateral_colour, numbers_of, radius_direction
from procedures.psf_field import Node

from .conftest import SEED
from .lens import NEAR, SHAPE, FieldCamera, K, S, nodes
from .lens import grid as node_grid

SLOW_FIXTURES = {"maps"}

COLUMNS = 11


@pytest.fixture(scope="module")
def maps(interpolated):
    return derive(interpolated.field, COLUMNS)


@pytest.mark.parametrize("number", range(len(MAPS)))
def test_the_truth_is_in_the_95_percent_band_over_the_field(camera, maps, number):
    one = maps[number]
    off = []
    for j, k in np.argwhere(np.isfinite(one.value)):
        x, y = float(one.x[k]), float(one.y[j])
        true = camera.numbers(x, y, radius_direction(SHAPE, x, y))[number]
        off.append((one.value[j, k] - true) / one.uncertainty[j, k])
    assert len(off) > 40
    assert np.mean(np.abs(off) < 1.96) >= 0.9
    # nor is the band too wide; the tail's error is common to all places of a map
    assert np.sqrt(np.mean(np.square(off))) > 0.4


def test_maps_reach_the_frames_corners_with_larger_uncertainty(camera, maps):
    off = []
    for one, number in zip(maps, range(len(MAPS)), strict=False):
        assert one.share < 0.8
        middle = one.uncertainty[len(one.y) // 2, len(one.x) // 2]
        for j, k in ((0, 0), (0, -1), (-1, 0), (-1, -1)):
            x, y = float(one.x[k]), float(one.y[j])
            assert not one.enclosed[j, k]
            assert one.uncertainty[j, k] > middle
            true = camera.numbers(x, y, radius_direction(SHAPE, x, y))[number]
            off.append((one.value[j, k] - true) / one.uncertainty[j, k])
    # the numbers of one PSF are correlated: one place of four may be off in all of them
    assert np.mean(np.abs(off) < 1.96) >= 0.75


def test_directions_follow_the_radius_and_places_are_centred_on_the_frame(covariance):
    # wide along x: meridional detail is lost to the right of the centre, sagittal detail below it
    x = (np.arange(K) - K // 2) / S
    h = np.exp(-((x / 0.9) ** 2) - (x[:, None] / 0.5) ** 2)
    psf = Psf(h / h.sum(), S, covariance[: K * K, : K * K])
    right, _ = numbers_of(psf, radius_direction(SHAPE, 700.0, 249.5))
    below, _ = numbers_of(psf, radius_direction(SHAPE, 374.5, 480.0))
    assert right[0] > right[1]
    assert below[0] < below[1]
    assert right[2] == pytest.approx(right[0] - right[1])
    np.testing.assert_allclose(right[:2], below[1::-1], rtol=1e-6)
    x, y = grid((500, 750), 15)
    assert (len(x), len(y)) == (15, 10)
    assert x[0] + x[-1] == pytest.approx(749)
    assert y[0] + y[-1] == pytest.approx(499)


@pytest.mark.slow
def test_lateral_colour_is_within_its_band(camera, covariance):
    # the surface has few degrees of freedom, so the errors of a map are correlated: five draws, 95 % +- 5 %
    near, z = FieldCamera(period_px=NEAR), []
    for seed in range(5):
        rng = np.random.default_rng(SEED + seed)
        green, red = (nodes(near, node_grid(), covariance, rng, plane) for plane in ("G1", "R"))
        colour = lateral_colour("R", red, "G1", green, SHAPE, 2)
        radial, tangential = colour.maps(7)
        for j, k in np.argwhere(np.isfinite(radial.value)):
            x, y = float(radial.x[k]), float(radial.y[j])
            shift = 2 * (camera.position(x, y, "R") - camera.position(x, y, "G1"))
            turn = radius_direction(SHAPE, x, y)
            for one, angle in ((radial, turn), (tangential, turn + np.pi / 2)):
                off = one.value[j, k] - shift @ [np.cos(angle), np.sin(angle)]
                z.append(off / one.uncertainty[j, k])
    assert np.mean(np.abs(z) < 1.96) >= 0.9
    # conservative, as the model error is an upper estimate, but not twice too wide
    assert np.sqrt(np.mean(np.square(z))) > 0.5


@pytest.mark.slow
def test_charts_that_only_one_plane_shows_do_not_count(camera, covariance, measured):
    red = nodes(camera, node_grid(), covariance, np.random.default_rng(1), "R")
    with pytest.raises(Refused, match="measured in both planes; R and G1 have 5"):
        lateral_colour("R", red[:5], "G1", measured, SHAPE, 2)


def test_a_turned_image_is_tangential_from_x_towards_y(rng):
    # 0.004 radians of rotation about the frame's centre; errors of 0.01 px at 25 charts cannot be mistaken for it
    centre, turn, psf = np.array([374.5, 249.5]), 0.004, Psf(np.ones((3, 3)) / 9, S, np.zeros((9, 9)))
    green, red = [], []
    for number, at in enumerate(node_grid()):
        off = turn * np.array([centre[1] - at[1], at[0] - centre[0]]) + 0.01 * rng.standard_normal(2)
        green.append(Node(at, np.zeros((2, 2)), 2 * at, psf, "made", number))
        red.append(Node(at, 0.005**2 * np.eye(2), 2 * at + off, psf, "made", number))
    colour = lateral_colour("R", red, "G1", green, SHAPE, 2)
    assert colour.surface.degree == 1
    radial, tangential = colour.maps(7)
    radius = np.hypot(*np.meshgrid(tangential.x - centre[0], tangential.y - centre[1]))
    inside = np.isfinite(radial.value)
    assert np.all(np.abs(tangential.value - turn * radius)[inside] < 4 * tangential.uncertainty[inside])
    assert np.all(np.abs(radial.value)[inside] < 4 * radial.uncertainty[inside])
    assert radial.uncertainty[inside].max() < 0.02
