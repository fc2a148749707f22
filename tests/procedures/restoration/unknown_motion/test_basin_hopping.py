"""Turns that descent cannot leave, and the curves of a pool and the bends by which they are left."""

from __future__ import annotations

import numpy as np
import pytest

from procedures.restoration.unknown_motion.basin_hopping import BendSettings, Turns
from procedures.restoration.unknown_motion.mask_evidence import MaskEvidence, cost, fitted, masks_at
from procedures.restoration.unknown_motion.motion_splines import POINTS

from ..motions import FLAT_W, curves

# lines about as wide as samples lie apart
HALF = 2 * FLAT_W
TRUE = 2 * curves()
NO_BENDS = BendSettings(number=0)


@pytest.fixture(scope="module")
def said():
    """Masks known entry by entry, each to a thousandth, at three sizes."""
    found = []
    for w in (0.8 * HALF, HALF, 1.4 * HALF):
        one = MaskEvidence.about(TRUE, HALF, w, 8)
        one.add(np.eye(one.masks.size), np.zeros(one.masks.size), 1e6)
        found.append(one)
    return found


@pytest.fixture(scope="module")
def wrong():
    """The first curve with its middle run through another way, which descent does not undo."""
    points = TRUE.copy()
    points[0, 5:15] = points[0, 5:15].mean(axis=0) - 0.7 * (points[0, 5:15] - points[0, 5:15].mean(axis=0))
    return points


def apart(points):
    """Share of the norm by which masks are wrong between the sizes told of."""
    a, b = (masks_at(p, HALF, 1.2 * HALF, 8) for p in (points, TRUE))
    return np.linalg.norm(a - b) / np.linalg.norm(b)


@pytest.mark.slow
def test_a_curve_of_the_pool_is_taken(said, wrong):
    pools = [[wrong[0], TRUE[0]], [wrong[1]]]
    found = Turns(pools, np.random.default_rng(0), NO_BENDS).taken(said, wrong, HALF)
    assert apart(fitted(said, wrong, HALF)[1]) > 0.1
    assert apart(found) < 0.05


@pytest.mark.slow
def test_a_pool_told_about_another_origin_is_moved(said, wrong):
    origin = np.array([1.0, 0.0])
    turns = Turns([[TRUE[0] + origin], [TRUE[1] + origin]], np.random.default_rng(0), NO_BENDS).beside(origin)
    assert apart(turns.taken(said, wrong, HALF)) < 0.05


@pytest.mark.slow
def test_bends_end_no_worse_than_descent(said):
    bend = np.exp(-(((np.arange(POINTS) - 8) / 2.0) ** 2))[:, None]
    begun = TRUE + bend * np.array([[[1.6, -1.2]], [[-1.2, 1.6]]])
    found = Turns([], np.random.default_rng(1), BendSettings(number=4)).taken(said, begun, HALF)
    alone = fitted(said, begun, HALF, (0, 1), 150, 15, 1e-3)[1]
    assert cost(said, found, HALF) < 1.01 * cost(said, alone, HALF)
