"""Subpixel curves: their masks, and their estimation from masks."""

import numpy as np
import pytest

from procedures.restoration.masks.blur_models import LINE, mask
from procedures.restoration.masks.line_rasterisation import line_mask_change
from procedures.restoration.unknown_motion import motion_splines

HALF = 3.0


@pytest.fixture(scope="module")
def points():
    """A smooth path of half-width 3 about the masks' centre."""
    t = (np.arange(motion_splines.POINTS) + 0.5) / motion_splines.POINTS
    wander = np.stack([np.cos(2 * np.pi * t) + 0.5 * np.sin(3 * np.pi * t), np.sin(2 * np.pi * t)], axis=1)
    wander -= (wander.max(axis=0) + wander.min(axis=0)) / 2
    return wander * HALF / motion_splines.half_width(wander)


@pytest.mark.parametrize("w", [1.7, 3.0, 4.6])
def test_a_curve_draws_the_masks_of_its_shape(points, w):
    # both are summed at eleven samples per pixel; the shape is linear between its 257 samples, the curve has 400
    # instants
    shape = motion_splines.shapes_of(points[None])[0]
    spline_mask = motion_splines.spline_mask(points * w / HALF, 6, LINE * w)
    true = mask(shape, w, 6)
    assert np.linalg.norm(spline_mask - true) < 0.005 * np.linalg.norm(true)


def test_a_mask_of_a_curve_keeps_its_light_and_has_its_derivatives(points):
    at, step = 0.3, 1e-5
    change = np.random.default_rng(1).standard_normal(points.shape)
    instants = motion_splines.INSTANTS
    path = motion_splines.basis(instants) @ points
    mask, pixels, J = line_mask_change(path, 5, at, *motion_splines.moving(instants), motion_splines.POINTS)
    np.testing.assert_allclose(mask, motion_splines.spline_mask(points, 5, at), atol=1e-15)
    above, below = (motion_splines.spline_mask(points + s * step * change, 5, at) for s in (1, -1))
    numeric = ((above - below) / (2 * step)).ravel()
    # of the exact integral: sums over samples d apart differ by some (d / sigma)^2 / 24 = 0.4 %
    assert np.linalg.norm(J @ change.T.ravel() - numeric[pixels]) < 0.01 * np.linalg.norm(numeric)
    assert not np.delete(numeric, pixels).any()
    assert motion_splines.spline_mask(points, 5, 0.1).sum() == pytest.approx(1, abs=1e-6)
    outside = points + np.array([3.0, 0.0])
    inside = (np.abs(motion_splines.basis() @ outside) < 2.5).all(axis=1).mean()
    assert motion_splines.spline_mask(outside, 2, 0.06).sum() == pytest.approx(inside, abs=0.03)
    # samples nine hundredths of a pixel apart hit a line of a hundredth rarely, but with all of its light in total
    assert motion_splines.spline_mask(points, 5, 0.01).sum() == pytest.approx(1, abs=1e-6)


@pytest.mark.slow
def test_curves_are_estimated_from_a_mask(points):
    target = motion_splines.spline_mask(points, 4, LINE * HALF)
    candidates = motion_splines.candidates(target, HALF, np.random.default_rng(3), 12)
    again = [motion_splines.spline_mask(one, 4, LINE * HALF) for one in candidates]
    # many curves draw one mask, with a line a fifth of a pixel wide; smooth ones are accepted within some per cent
    assert min(np.linalg.norm(mask - target) for mask in again) < 0.08 * np.linalg.norm(target)
    assert len(candidates) == 6


def test_a_recorded_path_starts_the_fit(points):
    # recorded in metres, about another origin; the mask corrects errors of the record
    shaken = motion_splines.basis() @ (points + np.random.default_rng(5).normal(0, 0.05, points.shape))
    candidates = motion_splines.fit_recorded(
        1e-4 * shaken + 0.3, motion_splines.spline_mask(points, 4, LINE * HALF), HALF
    )
    error = motion_splines.basis() @ (candidates - points)
    assert np.sqrt(np.mean(error**2)) < 0.15
