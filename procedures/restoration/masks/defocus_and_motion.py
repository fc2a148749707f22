"""Masks of photographs blurred by motion and defocus together, with one w for both (section 6.5).

The path of motion scales with w, proportional to the inverse depth; the half-width of defocus is linear in it (4.5),
zero at the plane of focus and negative, with the shape upside down, beyond.
"""

from collections.abc import Sequence

import numpy as np
from scipy.signal import fftconvolve

from procedures.restoration.masks.blur_models import masks_of, reach
from procedures.restoration.masks.blur_operator import MaskStack
from procedures.restoration.masks.mask_fields import MaskField, Masks
from procedures.restoration.masks.shape_fields import ShapeField


def with_defocus(
    motion: Sequence[Masks], shapes: Sequence[ShapeField], ratios: Sequence[float], offsets: Sequence[float]
) -> list[MaskField]:
    """Masks of motion convolved with defocus of half-width `ratios` w + `offsets`. Raises BadParameter for fields on
    different grids."""
    R = max(reach(one.max_w, a, b) for one, a, b in zip(motion, ratios, offsets, strict=True))
    each = zip(motion, shapes, ratios, offsets, strict=True)
    return [_spread(MaskField.of(one), shape, a, b, R) for one, shape, a, b in each]


def _spread(motion: MaskField, shapes: ShapeField, ratio: float, offset: float, R: int) -> MaskField:
    levels = np.arange(len(motion.middle.masks)) * motion.step
    defocus = MaskField(
        tuple(
            tuple(MaskStack(masks_of(one, ratio * levels + offset, R), motion.step) for one in row)
            for row in shapes.shapes
        )
    )
    grid = max((motion.grid, defocus.grid), key=lambda one: one[0] * one[1])
    pairs = zip(motion.spread(grid).stacks, defocus.spread(grid).stacks, strict=True)
    return MaskField(tuple(tuple(_convolved(*pair) for pair in zip(*rows, strict=True)) for rows in pairs))


def _convolved(first: MaskStack, second: MaskStack) -> MaskStack:
    masks = np.clip(fftconvolve(first.masks, second.masks, axes=(1, 2)), 0, None)
    return MaskStack(masks / masks.sum(axis=(1, 2), keepdims=True), first.step)
