from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from procedures import BadInput, Plane
from procedures.restoration.colour.estimate import (
    descended,
    error_of,
    mixing,
    problem_of,
    searched,
    shifted,
    spread_out,
    unknowns_of,
)
from procedures.restoration.colour.mosaic import depth_on_sensor, mosaics, spread
from procedures.restoration.masks.blur_models import mask_stack, pillbox
from procedures.restoration.masks.blur_operator import BlurOperator

PHASES = {
    "RGGB": {"R": (0, 0), "G1": (1, 0), "G2": (0, 1), "B": (1, 1)},
    "BGGR": {"R": (1, 1), "G1": (0, 1), "G2": (1, 0), "B": (0, 0)},
    "GRBG": {"R": (1, 0), "G1": (0, 0), "G2": (1, 1), "B": (0, 1)},
    "GBRG": {"R": (0, 1), "G1": (1, 1), "G2": (0, 0), "B": (1, 0)},
}
LIGHT = np.array([0.6, 1.0, 0.7])
SIGMA = 1.2e-3
SHAPE, R = (64, 80), 6


@pytest.fixture(scope="module")
def stacks():
    return [mask_stack(pillbox(), 4.2, ratio=ratio, R=R) for ratio in (1.0, 1.2)]


def photographed(u, w, stacks, origins, seed=0):
    """Mosaics of light u (3, H + 2R, W + 2R) at depth w, noise 40 dB under its contrast."""
    rng, frames = np.random.default_rng(seed), []
    for stack in stacks:
        blur = BlurOperator(stack, SHAPE)
        blur.focus(w)
        z = blur.blur(u)
        z = z + SIGMA * rng.standard_normal(z.shape)
        frames.append(
            {
                n: Plane(n, z["RGB".index(n[0]), y::2, x::2].astype(np.float32), 0.0, 2, (x, y))
                for n, (x, y) in origins.items()
            }
        )
    return frames


@pytest.fixture(scope="module")
def scene():
    """A grey scene with a contrast of some 30 levels, at two depths."""
    rng, extended = np.random.default_rng(5), (SHAPE[0] + 2 * R, SHAPE[1] + 2 * R)
    grey = 0.5 + 0.13 * np.sign(gaussian_filter(rng.standard_normal(extended), 5))
    grey += 0.3 * np.clip(gaussian_filter(rng.standard_normal(extended), 1.2), -0.4, 0)
    w = np.where(np.arange(extended[1]) > extended[1] / 2, 3.4, 2.4) * np.ones(extended)
    return gaussian_filter(grey, 0.6), w


def begun(u, w, stacks, origins):
    """Mosaics, the first picture, the data term and the unknowns."""
    planes = photographed(u, w, stacks, origins)
    mosaic = mosaics(planes, np.ones(2))
    first = spread({n: one.samples for n, one in planes[0].items()}, origins) / mosaic.gains[:, None, None]
    return mosaic, first, problem_of(mosaic, stacks, np.float32), unknowns_of(mosaic, first, R, np.float32)


def restored(u, w, stacks, origins):
    mosaic, first, term, u = begun(u, w, stacks, origins)
    u, _ = descended(term, u, w[R:-R, R:-R], SIGMA, joint=0)
    gains, picture = mosaic.gains[:, None, None], np.tensordot(np.linalg.inv(mixing()), u[:, R:-R, R:-R], axes=1)
    return gains * picture, term.residual(u).sum(axis=1, keepdims=True), first * gains


@pytest.mark.slow
@pytest.mark.parametrize("phase", PHASES)
def test_a_grey_scene_stays_grey_up_to_the_frame_s_edges(scene, stacks, phase):
    grey, w = scene
    picture, residual, first = restored(LIGHT[:, None, None] * grey, w, stacks, PHASES[phase])
    balanced = picture / LIGHT[:, None, None]
    # one grey level, including the noise, which deblurring amplifies some three times
    assert 255 * np.std(balanced[0] - balanced[2]) < 1
    truth = LIGHT[:, None, None] * grey[R:-R, R:-R]
    assert np.sqrt(np.mean((picture - truth) ** 2)) < 0.4 * np.sqrt(np.mean((first - truth) ** 2))
    assert residual.shape == (2, 1, *SHAPE)
    assert np.sqrt(np.mean(residual**2)) == pytest.approx(SIGMA, rel=0.25)  # of 20480 samples and 15360 unknowns


def test_blur_as_small_as_a_plane_s_pixels_is_estimated_on_the_sensor_s_grid(scene):
    """Planes alias such a scene, and underestimate w by up to a half."""
    grey, _ = scene
    stacks = [mask_stack(pillbox(), 3.0, ratio=ratio, R=R) for ratio in (1.0, 1.5)]
    true = np.full_like(grey, 1.4)
    *_, term, unknowns = begun(LIGHT[:, None, None] * grey, true, stacks, PHASES["RGGB"])
    start = np.full(SHAPE, 0.8)
    w, off = searched(term, unknowns, start, SIGMA)
    assert np.median(w) == pytest.approx(1.4, abs=0.15)
    assert np.mean(np.abs(start - 1.4) < 2 * off) > 0.95


@pytest.mark.slow
def test_estimated_error_of_a_colour_picture_is_its_error(scene, stacks):
    """The planes' own error estimate ignores demosaicking: it was less than half of the error."""
    grey, w = scene
    tint = np.sign(gaussian_filter(np.random.default_rng(8).standard_normal(grey.shape), 3))
    u = LIGHT[:, None, None] * grey * np.exp(np.array([0.3, 0.0, -0.2])[:, None, None] * tint)
    mosaic, _, term, unknowns = begun(u, w, stacks, PHASES["RGGB"])
    unknowns, _ = descended(term, unknowns, w[R:-R, R:-R], SIGMA, joint=0)
    error = np.abs(unknowns - np.tensordot(mixing(), u / mosaic.gains[:, None, None], axes=1))[:, R:-R, R:-R]
    std = spread_out(error_of(term, unknowns, w, SIGMA, SIGMA)[:, R:-R, R:-R], 2 * R + 1)
    assert 0.88 < np.mean(error < 2 * std) < 0.995


def test_colours_are_reproduced_and_shifts_in_the_masks_do_not_move_them(scene, stacks):
    grey, w = scene
    tint = np.sign(gaussian_filter(np.random.default_rng(8).standard_normal(grey.shape), 6))
    u = LIGHT[:, None, None] * grey * np.exp(np.array([0.3, 0.0, -0.2])[:, None, None] * tint)
    picture, _, first = restored(u, w, stacks, PHASES["RGGB"])
    truth = u[:, R:-R, R:-R]
    for c in range(3):
        assert np.std(picture[c] - truth[c]) < 0.5 * np.std(first[c] - truth[c])
    # masks shifted by whole pixels are exact: the photographs show the scene shifted by the same amount
    displaced = shifted(stacks, np.array([[0.0, 0.0], [2.0, -1.0]]))
    out = []
    for one in (stacks[1], displaced[1].middle):
        blur = BlurOperator(one, (SHAPE[0] - 2 * (one.R - R), SHAPE[1] - 2 * (one.R - R)))
        blur.focus(np.full_like(w, 3.0))
        out.append(blur.blur(grey))
    margin = displaced[1].R - R
    inside = slice(margin, -margin)
    expected = np.roll(out[0], (-1, 2), axis=(0, 1))[inside, inside]
    # the stack's stretched masks are interpolated by splines that preserve samples
    np.testing.assert_allclose(out[1], expected, atol=1e-6)


def test_depth_is_at_the_positions_of_the_planes_samples_of_a_known_layout(scene, stacks):
    x = np.arange(12.0)
    w = depth_on_sensor(np.tile(0.1 * x, (6, 1)), 0.28)
    # plane pixel i is at 2 i + 1/2 of the sensor, and w is in its pixels
    np.testing.assert_allclose(w[5, 4:-4], 2 * 0.1 * (np.arange(24.0)[4:-4] - 0.5) / 2, atol=1e-12)
    steps = depth_on_sensor(np.where(x > 5, 4.0, 2.0) * np.ones((6, 1)), 0.28)
    assert set(np.unique(steps)) == {4.0, 8.0}
    grey, w = scene
    planes = photographed(np.repeat(grey[None], 3, axis=0), w, stacks, PHASES["RGGB"])
    planes[1] = {name: replace(one, origin=PHASES["BGGR"][name]) for name, one in planes[1].items()}
    with pytest.raises(BadInput, match="mosaics of one layout"):
        mosaics(planes, np.ones(2))
