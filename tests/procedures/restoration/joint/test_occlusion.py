"""Occlusion at depth edges: detection, and uncertainties there in ray-traced scenes."""

import numpy as np
import pytest

from procedures import RestorationParameters, Scheme, restore, stacks_of
from procedures.restoration.joint.moved_objects import occlusion_of
from procedures.restoration.masks.blur_models import mask_stack, pillbox
from tests.benchmarks.restoration_scenes import picture
from tests.procedures.restoration.two_flats import lens, two_flats

X = np.arange(80.0) * np.ones((60, 1))
STACKS = [mask_stack(pillbox(), 5.0, ratio=ratio, R=8) for ratio in (1.0, 1.25)]


def test_an_edge_is_marked_within_the_reach_of_blur_and_a_slope_is_not():
    named = occlusion_of(np.where(X < 40, 2.0, 3.6), STACKS)
    columns = np.flatnonzero(named.mask[30])
    # 1.25 x 3.6 pixels and less than three more
    assert 39.5 - columns.min() == columns.max() - 39.5 == pytest.approx(1.25 * 3.6 + 1.5, abs=1.5)
    np.testing.assert_allclose(named.spread(np.full(X.shape, 0.02))[30, 40], 0.8)
    assert named.spread(np.full(X.shape, 0.02))[30, 5] == 0.02
    assert not occlusion_of(1.5 + 0.04 * X, STACKS).mask[:, 14:-14].any()
    assert not occlusion_of(np.full(X.shape, 2.0), STACKS).mask.any()


@pytest.mark.nightly
def test_uncertainties_at_an_edge_hold_with_occlusion():
    shape, openings = (120, 144), ((lens(9), 1.0), (lens(9), 1.25))
    case = two_flats(picture, shape, (2.5, 1.5), openings, 40.0, 4)
    stacks = stacks_of([one.shape for one, _ in openings], (1.0, 1.25), 4.0, shape)
    restored = restore(list(case.z), stacks, RestorationParameters(scheme=Scheme.parse("6x(8+8)+2x10"))).value
    inside = (slice(12, -12), slice(12, -12))
    off = np.abs(restored.w - case.w)[inside]
    assert np.mean(off < 2 * np.hypot(restored.w_std, 0.05)[inside]) > 0.9
    # without it a tenth of the frame and more would be confident and wrong
    assert np.mean(off[restored.occlusion[inside]] > 0.3) > 0.2
    assert np.mean(off[~restored.occlusion[inside]] > 0.3) < 0.02
