"""Refinement of paths from a flat part by other depths."""

import numpy as np
import pytest

from procedures import Outcome, Scheme, Verdict
from procedures.restoration.masks.blur_models import LINE, as_shape, mask
from procedures.restoration.unknown_motion import motion_splines, path_refinement
from procedures.restoration.unknown_motion.blind import Prototypes

from .. import motions
from ..motions import BOX, FLAT_W


@pytest.fixture(scope="module")
def curves():
    return motions.curves()


@pytest.fixture(scope="module")
def photographs():
    return motions.photographs()


@pytest.fixture(scope="module")
def prototypes(curves):
    """Masks of the flat part, known to whole pixels."""
    masks = np.stack([motion_splines.spline_mask(one, 2, LINE * FLAT_W) for one in curves])
    return Prototypes(masks, np.stack([as_shape(h, 2.5) for h in masks]), 2.5, 0.001)


@pytest.mark.nightly
def test_other_depths_correct_the_curves(photographs, prototypes, curves):
    # a tenth of a pixel off in the flat part, the typical difference of curves that draw one mask
    start = curves + np.random.default_rng(1).normal(0, 0.1, curves.shape)
    few = path_refinement.PathEffort(more=0, scheme=Scheme(4, 6, 6, 1, 6), descents=1, bends=0)
    rng, rounds = np.random.default_rng(0), []
    motion = path_refinement.motion_of_scene(photographs, BOX, prototypes, 3.5, rng, start, few, rounds.append)
    assert motion.path is not None
    assert [one.n for one in rounds] == [*range(1, rounds[-1].most + 1)]

    def error(shapes, half):
        """Error of both masks at the farther of the scene's depths."""
        w = 1.4
        pairs = zip(shapes, motion_splines.shapes_of(curves), strict=True)
        return sum(np.sum((mask(a, w * half, 5) - mask(b, w * FLAT_W, 5)) ** 2) for a, b in pairs) ** 0.5

    before = error(motion_splines.shapes_of(start), motion_splines.half_width(start))
    assert error(motion.shapes, motion.half_width) < 0.5 * before


def test_doubt_of_a_narrow_part_stands_behind_other_reasons(photographs, prototypes):
    motion = path_refinement.motion_of_scene(photographs, (0, 0, 20, 96), prototypes, 3.5, np.random.default_rng(0))
    assert motion.path is None
    outcome = motion.judged(Outcome(1.0))
    assert outcome.verdict is Verdict.DOUBTFUL
    assert "narrower" in outcome.reason
    assert "mark a larger" in outcome.remedy
    motion = path_refinement.MotionShapes(prototypes.shapes, 2.5, None, "caveat")
    assert motion.judged(Outcome(None, Verdict.REFUSED, "other", "do")).reason == "other"


@pytest.mark.parametrize(("span", "recorded", "flat"), [(0.2, False, True), (0.2, True, False), (1.2, False, False)])
def test_paths_of_a_flat_scene_are_doubtful_unless_they_were_recorded(curves, span, recorded, flat):
    w = FLAT_W + span * np.linspace(-0.5, 0.5, 100).reshape(10, 10)
    motion = path_refinement._judged(path_refinement._Fit(curves, w, np.zeros((1, 1, 1)), 0.7), recorded=recorded)
    outcome = motion.judged(Outcome(1.0))
    assert ("the scene is flat" in outcome.reason) is flat
    assert (outcome.verdict is Verdict.DOUBTFUL) is flat
