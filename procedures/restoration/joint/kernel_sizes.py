"""Kernels measured in the sensor's pixels: default sizes and ratios, and the masks of given shapes."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from procedures.outcome import BadParameter, Refused
from procedures.restoration.first_depth.registration import register
from procedures.restoration.joint.estimate import noise_of
from procedures.restoration.masks.blur_models import mask_stack, reach
from procedures.restoration.masks.blur_operator import Array, MaskStack
from procedures.restoration.masks.checks import check_extent

Shapes = Sequence[NDArray[np.float64]]

MEASURED = 40
"""Shapes of fewer samples a side may be kernels with one sample a pixel; model shapes have hundreds."""
DEFAULT_MAX_W = 8.0
"""Default of the largest w, pixels: time grows with its square."""
BEYOND = 0.3
"""Margin of the masks beyond the largest w, pixels: detects w beyond the end of the range."""


def default_max_w(shapes: Shapes) -> float:
    """Default of the largest w: a pixel more than the measured kernels' half-width, or 8 pixels."""
    return max([DEFAULT_MAX_W, *((len(s) - 1) / 2 + 1 for s in shapes if len(s) < MEASURED)])


def size_ratios(shapes: Shapes) -> tuple[float, ...]:
    """w of every photograph over w of the first for kernels with one sample a pixel; else all 1."""
    if any(len(s) >= MEASURED for s in shapes):
        return (1.0,) * len(shapes)
    return tuple((len(s) - 1) / (len(shapes[0]) - 1) for s in shapes)


def stacks_of(
    shapes: Shapes, ratios: Sequence[float], max_w: float, frame: tuple[int, int], offsets: Sequence[float] = ()
) -> list[MaskStack]:
    """Masks of every photograph, for w of the first from 0 to slightly beyond `max_w`. frame : (H, W).

    ratios, offsets : half-width of each is ratio times w plus offset, pixels; offsets default to 0 (4.8, 4.14).

    Raises BadParameter if a ratio or w is not positive, a shape has no ratio, or the masks are too large.
    """
    if len(ratios) != len(shapes) or len(offsets) not in (0, len(shapes)) or not 0 < max_w < np.inf:
        raise BadParameter(
            f"{len(shapes)} shapes need as many ratios, offsets or none, and a largest w above 0; got {len(ratios)}, "
            f"{len(offsets)} and {max_w:g}",
            "give one of each for every photograph",
        )
    for ratio in ratios:
        if not 0 < ratio < np.inf:
            raise BadParameter(f"a ratio of w must be positive, got {ratio:g}", "give w of that photograph over w of 1")
    sizes = [*zip(ratios, tuple(offsets) or (0.0,) * len(ratios), strict=True)]
    R = max(reach(max_w + BEYOND), *(reach(max_w + BEYOND, *size) for size in sizes))
    check_extent(R, frame)
    widest = max_w + BEYOND
    return [mask_stack(shape, widest, ratio=a, offset=b, R=R) for shape, (a, b) in zip(shapes, sizes, strict=True)]


def fitting_ratios(photographs: Sequence[Array], shapes: Shapes, max_w: float) -> tuple[float, ...]:
    """Default ratios for photographs (C, H, W): 1, or the kernels' sizes where these explain them better. Raises as
    `stacks_of`."""
    even, sized = (1.0,) * len(shapes), size_ratios(shapes)
    frame = (photographs[0].shape[1], photographs[0].shape[2])
    if sized == even:
        return even
    z = np.stack(photographs)
    return min((even, sized), key=lambda ratios: _disagreement(z, stacks_of(shapes, ratios, max_w, frame)))


def _disagreement(z: Array, stacks: list[MaskStack]) -> float:
    """Disagreement of the photographs (P, C, H, W) after registration; infinite if they cannot be registered."""
    try:
        registered = register(z, np.ones((len(z), 1, *z.shape[2:])), stacks)
    except Refused:
        return float(np.inf)
    pairs = [[0, n] for n in range(1, len(z))]
    return float(np.mean([noise_of(registered.z[pair], [stacks[n] for n in pair]) for pair in pairs]))
