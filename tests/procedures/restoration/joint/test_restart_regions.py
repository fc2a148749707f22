"""Restarted regions: a deliberately misplaced depth edge is detected by its residual and corrected."""

import numpy as np
import pytest

from procedures.restoration.joint import joint_descent
from procedures.restoration.joint.data_term import restore_picture
from procedures.restoration.joint.gauss_newton import PriorWeights, joint_step
from procedures.restoration.joint.joint_descent import (
    RegionAttempt,
    better_of,
    relative_residual,
    reliable_segments,
    restart,
    unexplained,
)
from procedures.restoration.joint.priors import steps_allowed

WEIGHTS = PriorWeights(1e-4, 0.01)


@pytest.fixture(scope="module")
def terms(vibrating):
    return joint_descent.problem_of(vibrating.z, vibrating.stacks, np.ones((2, 1, *vibrating.z.shape[2:])), np.float32)


@pytest.fixture(scope="module")
def notched(vibrating, terms):
    """The near square with a corner assigned to the background, and the best picture for that."""
    w = vibrating.w.astype(np.float32)
    H, W = w.shape
    y, x = np.mgrid[0:H, 0:W]
    near = (y > H * 0.55) & (x > W * 0.5)
    notch = near & (y < H * 0.55 + 11) & (x < W * 0.5 + 12)
    w = np.where(notch, w - 1, w).astype(np.float32)
    terms[0].focus(w)
    u = restore_picture(terms[0], np.full(vibrating.sharp.shape, 0.5, np.float32), 1e-4, 40)
    return RegionAttempt(u, w, np.where(near & ~notch, 2, 1).astype(np.int32)), notch


def onward(data, pair):
    for _ in range(3):
        down, across = steps_allowed(pair.w, WEIGHTS.step)
        same = pair.labels[1:] == pair.labels[:-1], pair.labels[:, 1:] == pair.labels[:, :-1]
        u, w = joint_step(data, pair.u, pair.w, WEIGHTS, 20, (1.0, 1.0), (down * same[0], across * same[1]))
        pair = RegionAttempt(u, w, pair.labels)
    return pair


def test_residuals_are_largest_in_the_wrong_region(rng, terms, notched):
    e = rng.standard_normal((2, 1, 80, 90))
    e[..., 30:50, 20:50] *= 2
    power = relative_residual(e)
    # means of 98 squares: 0.14 each, the mean of several hundred such windows a tenth of that
    assert np.mean(power[:25]) == pytest.approx(1, abs=0.06)
    assert np.mean(power[34:46, 24:46]) == pytest.approx(4, rel=0.1)
    np.testing.assert_allclose(relative_residual(0.01 * e), power)
    pair, notch = notched
    terms[0].focus(pair.w)
    wrong = unexplained(terms[0], pair.u)
    assert wrong[notch].mean() > 0.9
    assert wrong.mean() < 0.35


@pytest.mark.slow
def test_a_region_of_the_wrong_surface_is_corrected(vibrating, terms, notched):
    pair, notch = notched

    def error(w):
        return np.sqrt(np.mean((w - vibrating.w)[notch] ** 2))

    descended = onward(terms[0], pair)
    restarted_pair = restart(*terms, pair, 12, WEIGHTS.picture, lambda p, _: onward(terms[0], p))
    # descent alone corrects little of the pixel by which the depth is wrong
    assert error(descended.w) > 0.6
    assert error(restarted_pair.w) < 0.35
    assert (restarted_pair.labels[notch] == 2).mean() > 0.85


def test_wrong_segments_join_their_neighbours_where_the_residual_falls(vibrating, terms, notched):
    labels = np.ones((40, 40), np.int32)
    labels[:, 20:] = 2
    labels[5:15, 2:12] = 3
    wrong = labels == 3
    reliable = reliable_segments(labels, wrong)
    assert set(np.unique(reliable)) == {1, 2}
    assert (reliable[wrong] == 1).all()
    assert (reliable_segments(labels, np.ones((40, 40), bool)) == labels).all()
    pair, notch = notched
    truth = RegionAttempt(vibrating.sharp.astype(np.float32), vibrating.w.astype(np.float32), pair.labels)
    best = better_of(terms[0], pair, truth, notch)
    assert np.abs(best.w - truth.w)[notch].max() < 1e-6
    assert better_of(terms[0], truth, pair, notch).w == pytest.approx(truth.w)
