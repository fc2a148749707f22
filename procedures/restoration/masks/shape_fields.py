"""Shapes of blur over the frame: one for every node of a grid, also from a few of an axially symmetric lens.

One shape is a grid of one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

from procedures.numerics.arrays import Array
from procedures.outcome import BadParameter
from procedures.restoration.masks.blur_models import mask_stack
from procedures.restoration.masks.mask_fields import MaskField, positions

GRID = (5, 7)
"""Nodes over the frame: with a lens that vignettes, three by four were half as effective."""


@dataclass(frozen=True)
class ShapeField:
    """Shapes on [-1, 1] over the frame, rows of columns, all of one half-width."""

    shapes: tuple[tuple[Array, ...], ...]

    def masks(self, max_w: float, R: int, ratio: float = 1.0, offset: float = 0.0) -> MaskField:
        """The masks of a photograph whose half-width is `ratio` w + `offset`, w up to `max_w`."""
        return MaskField(
            tuple(tuple(mask_stack(one, max_w, ratio=ratio, offset=offset, R=R) for one in row) for row in self.shapes)
        )


def symmetric(radial: Sequence[Array], shape: tuple[int, int], grid: tuple[int, int] = GRID) -> ShapeField:
    """Shapes over a photograph (H, W) for a lens that is symmetric about its axis at the frame's centre (4.20).

    radial : shapes of one size at equal heights from the centre of the frame to its corner, oriented as on its right,
    along +x; interpolated between heights.

    Raises BadParameter if there are fewer than two, or they differ in size.
    """
    sizes = sorted({len(one) for one in radial})
    if len(radial) < 2 or len(sizes) > 1:
        raise BadParameter(
            f"shapes of a symmetric lens are two or more of one size, got {len(radial)} of sizes {sizes}",
            "give those of the centre, of the corner, and of equal heights between, sampled equally",
        )
    rows, columns = positions(grid, shape, 0)
    corner = np.hypot(shape[0] - 1, shape[1] - 1) / 2

    def at(y: float, x: float) -> Array:
        height = np.hypot(x, y) / corner * (len(radial) - 1)
        k = min(int(height), len(radial) - 2)
        return rotated((k + 1 - height) * radial[k] + (height - k) * radial[k + 1], float(np.arctan2(y, x)))

    y, x = rows - (shape[0] - 1) / 2, columns - (shape[1] - 1) / 2
    return ShapeField(tuple(tuple(at(float(b), float(a)) for a in x) for b in y))


def rotated(shape: Array, angle_rad: float) -> Array:
    """The shape rotated by `angle_rad`: the blur of an axially symmetric lens at the same height (4.20)."""
    half, c, s = (len(shape) - 1) / 2, np.cos(angle_rad), np.sin(angle_rad)
    x, y = np.meshgrid(*[np.linspace(-1, 1, len(shape))] * 2)
    turned = map_coordinates(shape, [(-s * x + c * y + 1) * half, (c * x + s * y + 1) * half], order=1)
    return np.asarray(turned, dtype=np.float64)
