"""Local minima of descent, and their escape by curves of a pool and by random bends."""

import numpy as np
import pytest

from procedures.restoration.unknown_motion.basin_hopping import BasinHopping
from procedures.restoration.unknown_motion.mask_evidence import MaskEvidence, cost, fit_curves, masks_at
from procedures.restoration.unknown_motion.motion_splines import POINTS

from ..motions import FLAT_W, curves

pytestmark = pytest.mark.slow

# lines about as wide as the spacing of samples
HALF = 2 * FLAT_W
TRUE = 2 * curves()
NO_BENDS = 0


@pytest.fixture(scope="module")
def evidence():
    """Masks known entry by entry, each to a thousandth, at three sizes."""
    best = []
    for w in (0.8 * HALF, HALF, 1.4 * HALF):
        one = MaskEvidence.about(TRUE, HALF, w, 8)
        one.add(np.eye(one.masks.size), np.zeros(one.masks.size), 1e6)
        best.append(one)
    return best


@pytest.fixture(scope="module")
def wrong():
    """The first curve with a detour in its middle, which descent does not remove."""
    points = TRUE.copy()
    points[0, 5:15] = points[0, 5:15].mean(axis=0) - 0.7 * (points[0, 5:15] - points[0, 5:15].mean(axis=0))
    return points


def relative_error(points):
    """Relative error of the masks at sizes between the given ones."""
    a, b = (masks_at(p, HALF, 1.2 * HALF, 8) for p in (points, TRUE))
    return np.linalg.norm(a - b) / np.linalg.norm(b)


@pytest.mark.nightly
def test_a_curve_of_the_pool_is_accepted(evidence, wrong):
    pools = [[wrong[0], TRUE[0]], [wrong[1]]]
    best = BasinHopping(pools, np.random.default_rng(0), NO_BENDS).minimise(evidence, wrong, HALF)
    assert relative_error(fit_curves(evidence, wrong, HALF)[1]) > 0.1
    assert relative_error(best) < 0.05


def test_a_pool_is_moved_and_bends_end_no_worse_than_descent(evidence, wrong):
    origin = np.array([1.0, 0.0])
    hopping = BasinHopping([[TRUE[0] + origin], [TRUE[1] + origin]], np.random.default_rng(0), NO_BENDS).about_origin(
        origin
    )
    assert relative_error(hopping.minimise(evidence, wrong, HALF)) < 0.05
    bend = np.exp(-(((np.arange(POINTS) - 8) / 2.0) ** 2))[:, None]
    start = TRUE + bend * np.array([[[1.6, -1.2]], [[-1.2, 1.6]]])
    best = BasinHopping([], np.random.default_rng(1), 4).minimise(evidence, start, HALF)
    alone = fit_curves(evidence, start, HALF, (0, 1), 150, 15, 1e-3)[1]
    assert cost(evidence, best, HALF) < 1.01 * cost(evidence, alone, HALF)
