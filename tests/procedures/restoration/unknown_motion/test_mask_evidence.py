"""Evidence of tiles on masks: none from a common picture or a depth, the rest as a sum of squares."""

import numpy as np
import pytest

from procedures.restoration.masks.blur_models import LINE
from procedures.restoration.unknown_motion.mask_evidence import (
    EvidenceTile,
    MaskEvidence,
    cost,
    filters,
    fit_curves,
    gather,
    masks_at,
    rows,
    unexplained,
)

from ..motions import FLAT_W, curves

SIZE, R = 24, 5


@pytest.fixture
def points():
    return curves()


@pytest.fixture
def around(rng):
    return rng.standard_normal((SIZE + 2 * R, SIZE + 2 * R))


@pytest.fixture
def rng():
    return np.random.default_rng(8)


def blurred(around, mask):
    """A tile of the convolution of its surroundings with a mask."""
    size = mask.shape[0]
    views = np.lib.stride_tricks.sliding_window_view(around, mask.shape)[..., ::-1, ::-1]
    trim = (around.shape[0] - SIZE - size + 1) // 2
    return np.tensordot(views, mask, 2)[trim : trim + SIZE, trim : trim + SIZE]


def test_rows_keep_scalar_products(rng):
    x, y = rng.standard_normal((2, SIZE, SIZE))
    assert rows(np.fft.rfft2(x)) @ rows(np.fft.rfft2(y)) == pytest.approx(np.sum(x * y))


def test_a_common_picture_leaves_nothing(rng, points):
    masks = masks_at(points, FLAT_W, FLAT_W, 4)
    v = np.fft.rfft2(rng.standard_normal((SIZE, SIZE)))
    wrapped = np.zeros((2, SIZE, SIZE))
    wrapped[:, :9, :9] = masks
    errors = np.fft.irfft2(v * np.fft.rfft2(np.roll(wrapped, (-4, -4), (1, 2))), (SIZE, SIZE))
    assert np.linalg.norm(unexplained(errors, filters(masks, SIZE))) < 1e-10 * np.linalg.norm(errors)


def test_half_of_the_noise_is_unexplained(rng, points):
    errors = rng.standard_normal((200, 2, SIZE, SIZE))
    filtering = filters(masks_at(points, FLAT_W, FLAT_W, 4), SIZE)
    unexplained_power = np.mean([np.sum(unexplained(one, filtering) ** 2) for one in errors]) / SIZE**2
    # two samples per pixel, of which the picture takes one; the floor of the spectra takes some per cent
    assert 0.85 < unexplained_power < 1.02


def test_chi_square_is_that_of_other_masks(rng, points, around):
    about = MaskEvidence.about(points, FLAT_W, FLAT_W, R)
    errors = rng.standard_normal((2, SIZE, SIZE))
    gather(about, np.zeros_like(about.masks), [EvidenceTile(errors, around, flat=True)])
    other = masks_at(points + 0.1 * rng.standard_normal(points.shape), FLAT_W, FLAT_W, about.R)
    changed = errors - np.stack([blurred(around, d) for d in other - about.masks])
    expected = np.sum(unexplained(changed, filters(about.masks, SIZE)) ** 2)
    assert about.chi_square(other) == pytest.approx(expected, rel=1e-6)


def test_a_wrong_depth_is_no_evidence_against_masks(points, around):
    about = MaskEvidence.about(points, FLAT_W, FLAT_W, R)
    slope = (masks_at(points, FLAT_W, FLAT_W + 0.01, about.R) - masks_at(points, FLAT_W, FLAT_W - 0.01, about.R)) / 0.02
    tile = EvidenceTile(0.3 * np.stack([blurred(around, d) for d in slope]), around, flat=False)
    gather(about, slope, [tile])
    assert about.c < 1e-3 * np.sum(unexplained(tile.errors, filters(about.masks, SIZE)) ** 2)


def test_a_curve_is_fitted_to_evidence_of_three_sizes(rng, points):
    # masks known entry by entry, to 0.0003, at three sizes; lines about as wide as the spacing of samples
    half = 2 * FLAT_W
    points, evidence = 2 * points, []
    for w in (0.8 * half, half, 1.4 * half):
        one = MaskEvidence.about(points, half, w, 8)
        one.add(np.eye(one.masks.size), np.zeros(one.masks.size), 1e7)
        evidence.append(one)
    start = points + rng.normal(0, 0.1, points.shape)
    value, fit = fit_curves(evidence, start, half)
    assert value == pytest.approx(cost(evidence, fit, half))
    assert value < 0.01 * cost(evidence, start, half)
    before, after, true = (masks_at(p, half, 1.2 * half, 8) for p in (start, fit, points))
    # three starts of four end at 0.16 of it and less, one at 0.3
    assert np.linalg.norm(after - true) < 0.35 * np.linalg.norm(before - true)


def test_a_fixed_curve_is_unchanged(rng, points):
    one = MaskEvidence.about(points, FLAT_W, FLAT_W, R)
    one.add(np.eye(one.masks.size), np.zeros(one.masks.size), 1e4)
    start = points + rng.normal(0, 0.05, points.shape)
    fit = fit_curves([one], start, FLAT_W, (1,))[1]
    assert (fit[0] == start[0]).all()
    assert (fit[1] != start[1]).any()


def test_a_descent_without_prospect_is_abandoned(rng, points):
    one = MaskEvidence.about(points, FLAT_W, FLAT_W, R)
    one.add(np.eye(one.masks.size), np.zeros(one.masks.size), 1e6)
    start = points + rng.normal(0, 0.1, points.shape)
    least, first = fit_curves([one], start, FLAT_W)[0], cost([one], start, FLAT_W)
    assert fit_curves([one], start, FLAT_W, below=first / 30)[0] == first
    assert fit_curves([one], start, FLAT_W, below=first / 10)[0] == least


def test_masks_keep_their_line(points):
    # a line's width grows with the masks (5.3)
    large = masks_at(points, FLAT_W, 2 * FLAT_W, 8)
    assert large.shape == (2, 17, 17)
    assert large.sum(axis=(1, 2)) == pytest.approx([1, 1], abs=1e-6)
    assert LINE * 2 * FLAT_W < 0.1
