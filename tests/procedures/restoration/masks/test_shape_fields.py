"""Shapes over the frame, and motion convolved with them."""

import numpy as np
import pytest

from procedures.outcome import BadParameter
from procedures.restoration.masks.blur_models import mask_stack, pillbox, uniform_motion
from procedures.restoration.masks.blur_operator import MaskStack
from procedures.restoration.masks.defocus_and_motion import with_defocus
from procedures.restoration.masks.mask_fields import MaskField
from procedures.restoration.masks.shape_fields import ShapeField, symmetric

FRAME = (121, 161)


def coma():
    """A disc with light increasing towards +x."""
    t = np.linspace(-1, 1, 257)
    x, y = np.meshgrid(t, t)
    return np.where(x**2 + y**2 <= 1, 1 + x, 0.0)


def centroid(mask):
    t = np.arange(len(mask)) - len(mask) // 2
    return np.array([(mask * t).sum(), (mask * t[:, None]).sum()])


def variances(mask):
    t = np.arange(len(mask)) - len(mask) // 2
    across, down = mask.sum(axis=0), mask.sum(axis=1)
    return np.array([across @ t**2 - (across @ t) ** 2, down @ t**2 - (down @ t) ** 2])


def test_an_axially_symmetric_lens_rotates_its_shape_and_coma_points_outwards():
    field = symmetric([pillbox(), coma()], FRAME, (3, 3)).masks(3.0, 4)
    right, left = field.stacks[1][2].at(3.0), field.stacks[1][0].at(3.0)
    np.testing.assert_allclose(left, right[:, ::-1], atol=2e-3)  # bilinear rotation of the shape
    assert np.hypot(*centroid(field.middle.at(3.0))) < 0.02
    # a disc of light 1 + a x has its centroid at a w / 4; a is proportional to the height, 1 in the corner
    field = symmetric([pillbox(), coma()], FRAME, (3, 3)).masks(3.0, 4)
    corner, side = centroid(field.stacks[2][2].at(3.0)), centroid(field.stacks[1][2].at(3.0))
    outwards = np.array([80.0, 60.0])
    np.testing.assert_allclose(corner, 0.75 * outwards / 100, rtol=0.03)
    np.testing.assert_allclose(side, [0.75 * 0.8, 0.0], atol=0.02)


@pytest.mark.parametrize("radial", [[pillbox()], [pillbox(), coma()[1:-1, 1:-1]]], ids=["one", "sizes"])
def test_invalid_lenses_are_refused(radial):
    with pytest.raises(BadParameter, match="two or more of one size"):
        symmetric(radial, FRAME)


def test_defocus_and_motion_are_convolved_at_each_position():
    motion, defocus = mask_stack(uniform_motion(0.4), 2.0, R=4), ShapeField(((pillbox(),),))
    (together,) = with_defocus([motion], [defocus], [0.5], [1.0])
    # half-width 0.5 w + 1, and the pixel that each mask contains
    expected = variances(motion.at(2.0)) + variances(mask_stack(pillbox(), 2.0).at(2.0))
    np.testing.assert_allclose(variances(together.at(2.0)), expected, rtol=1e-6)
    assert together.R == 4 + 3
    motion = MaskStack(mask_stack(uniform_motion(), 2.0, R=3).masks, 0.05)
    lens = symmetric([pillbox(), coma()], FRAME, (3, 3))
    first, second = with_defocus([motion, motion], [lens, lens], [1.0, 1.2], [0.0, 0.0])
    assert first.grid == second.grid == (3, 3)
    assert first.R == second.R
    assert centroid(first.stacks[1][2].at(2.0))[0] > 0.1
    with pytest.raises(BadParameter, match="grids of masks differ"):
        with_defocus([MaskField(((motion, motion),))], [lens], [1.0], [0.0])
