"""Parts begun again: a depth step put deliberately in the wrong place is found by what it leaves and set right."""

from __future__ import annotations

import numpy as np
import pytest

from procedures.restoration.joint import joint_descent
from procedures.restoration.joint.data_term import restore_picture
from procedures.restoration.joint.gauss_newton import PriorWeights, joint_step
from procedures.restoration.joint.priors import steps_allowed
from procedures.restoration.joint.restart_regions import (
    RegionAttempt,
    RestartSettings,
    believed,
    better_of,
    left_over,
    repaired,
    unexplained,
)

WEIGHTS = PriorWeights(1e-4, 0.01)


@pytest.fixture(scope="module")
def terms(vibrating):
    return joint_descent.problem_of(vibrating.z, vibrating.stacks, np.ones((2, 1, *vibrating.z.shape[2:])), np.float32)


@pytest.fixture(scope="module")
def notched(vibrating, terms):
    """The near square with a corner taken for background, its picture restored as well as that lets it."""
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


def test_what_is_left_over_is_told_of_the_usual(rng):
    e = rng.standard_normal((2, 1, 80, 90))
    e[..., 30:50, 20:50] *= 2
    power = left_over(e)
    # means of 98 squares: 0.14 each, the mean of several hundred such windows a tenth of that
    assert np.mean(power[:25]) == pytest.approx(1, abs=0.06)
    assert np.mean(power[34:46, 24:46]) == pytest.approx(4, rel=0.1)
    np.testing.assert_allclose(left_over(0.01 * e), power)


def test_what_is_not_explained_is_the_part_that_is_wrong(terms, notched):
    pair, notch = notched
    terms[0].focus(pair.w)
    wrong = unexplained(terms[0], pair.u, RestartSettings())
    assert wrong[notch].mean() > 0.9
    assert wrong.mean() < 0.35


@pytest.mark.slow
def test_a_part_of_the_wrong_surface_gets_the_right_one(vibrating, terms, notched):
    pair, notch = notched

    def error(w):
        return np.sqrt(np.mean((w - vibrating.w)[notch] ** 2))

    left = onward(terms[0], pair)
    found = repaired(*terms, pair, 12, 0.28, WEIGHTS.picture, lambda p: onward(terms[0], p))
    # descent alone leaves most of the pixel that the depth is wrong by
    assert error(left.w) > 0.6
    assert error(found.w) < 0.35
    assert (found.labels[notch] == 2).mean() > 0.85


def test_segments_that_are_wrong_all_over_go_to_their_neighbours():
    labels = np.ones((40, 40), np.int32)
    labels[:, 20:] = 2
    labels[5:15, 2:12] = 3
    wrong = labels == 3
    kept = believed(labels, wrong, RestartSettings())
    assert set(np.unique(kept)) == {1, 2}
    assert (kept[wrong] == 1).all()
    assert (believed(labels, np.ones((40, 40), bool), RestartSettings()) == labels).all()


def test_what_leaves_less_is_kept_place_by_place(vibrating, terms, notched):
    pair, notch = notched
    truth = RegionAttempt(vibrating.sharp.astype(np.float32), vibrating.w.astype(np.float32), pair.labels)
    best = better_of(terms[0], pair, truth, notch, 2)
    assert np.abs(best.w - truth.w)[notch].max() < 1e-6
    assert better_of(terms[0], truth, pair, notch, 2).w == pytest.approx(truth.w)
