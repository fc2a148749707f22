"""Paths from a flat part, made finer by what lies at other depths."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from procedures.outcome import Outcome, Verdict
from procedures.restoration import many_depths, paths
from procedures.restoration.blind import Prototypes, as_shape
from procedures.restoration.blur_models import LINE, mask, mask_stack
from procedures.restoration.forward import Blur

FLAT_W = 2.0
BOX = (0, 0, 72, 96)


def curve(turns):
    """Control points of a smooth closed curve of half-width 2 about the middle."""
    t = 2 * np.pi * np.arange(paths.POINTS) / (paths.POINTS - 1)
    points = np.stack([np.cos(t) + 0.6 * np.sin(turns * t), np.sin(t) + 0.5 * np.cos(turns * t)], axis=1)
    points -= (points.max(axis=0) + points.min(axis=0)) / 2
    return points * FLAT_W / paths.half_width(points)


@pytest.fixture(scope="module")
def curves():
    return np.stack([curve(2), curve(3)[:, ::-1]])


@pytest.fixture(scope="module")
def photographs(curves):
    """A wall through two motions, flat at half-width 2 in its left part, coming nearer in its right part, 40 dB."""
    rng = np.random.default_rng(4)
    shape, R = (96, 144), 5
    extended = (shape[0] + 2 * R, shape[1] + 2 * R)
    u = 0.5 + 0.2 * np.sign(gaussian_filter(rng.standard_normal(extended), 2)) + 0.03 * rng.standard_normal(extended)
    w = FLAT_W + 0.02 * np.clip(np.arange(extended[1]) - 80.0, 0, None)
    z = []
    for one in paths.shapes_of(curves):
        blur = Blur(mask_stack(one, 4.0, R=R), shape)
        blur.focus(np.broadcast_to(w, extended).copy())
        z.append(blur.blur(u))
    return [a[None] + rng.standard_normal(shape) * a.std() / 100 for a in z]


@pytest.fixture(scope="module")
def found(curves):
    """Masks of the flat part, known to whole pixels."""
    masks = np.stack([paths.drawn(one, 2, LINE * FLAT_W) for one in curves])
    return Prototypes(masks, np.stack([as_shape(h, 2.5) for h in masks]), 2.5, 0.001)


def test_other_depths_put_the_curves_in_their_place(photographs, found, curves, monkeypatch):
    # a tenth of a pixel off in the flat part, as curves that draw one mask differ
    begun = curves + np.random.default_rng(1).normal(0, 0.1, curves.shape)
    for name, few in (("FIRST", many_depths.FIRST[-1:]), ("REDRAWN", 0), ("LAST", 3)):
        monkeypatch.setattr(many_depths, name, few)
    motion = many_depths.motion_of_scene(photographs, BOX, found, 3.5, np.random.default_rng(0), begun)
    assert motion.path is not None

    def error(shapes, half):
        """Of the masks of both at the farther of the scene's depths."""
        w = 1.4
        pairs = zip(shapes, paths.shapes_of(curves), strict=True)
        return sum(np.sum((mask(a, w * half, 5) - mask(b, w * FLAT_W, 5)) ** 2) for a, b in pairs) ** 0.5

    before = error(paths.shapes_of(begun), paths.half_width(begun))
    assert error(motion.shapes, motion.half_width) < 0.5 * before


def test_a_part_too_narrow_leaves_a_doubt(photographs, found):
    motion = many_depths.motion_of_scene(photographs, (0, 0, 20, 96), found, 3.5, np.random.default_rng(0))
    assert motion.path is None
    outcome = motion.judged(Outcome(1.0))
    assert outcome.verdict is Verdict.DOUBTFUL
    assert "narrower" in outcome.reason
    assert "mark a larger" in outcome.remedy


def test_what_is_wrong_otherwise_comes_first(found):
    motion = many_depths.MotionShapes(found.shapes, 2.5, None, "doubt")
    assert motion.judged(Outcome(None, Verdict.REFUSED, "other", "do")).reason == "other"
