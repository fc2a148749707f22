"""Motion between the photographs: places that no common picture explains while it explains the rest.

Errors of the masks leave residuals everywhere, in proportion to the scene; noise is uniform. A moved object leaves its
own contrast, in one place.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import find_objects, label, uniform_filter

from procedures.numerics.arrays import Mask
from procedures.restoration.first_depth.segments import span
from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.masks.mask_fields import Masks, half_size_at

WINDOW = 15
"""Side of a place, pixels."""
OVER_FRAME = 3.5
"""Local residual over the frame's median, root mean square, above which something moved: up to 1.5 with true masks, 2
with a mask rotated by 20 degrees or the two masks exchanged, 4 for a disc of 33 pixels that moved by 3, 5 to 26 for
discs that moved farther."""
OVER_NOISE, OF_CONTRAST = 2.5, 0.25
"""Thresholds over noise and over the photographs' contrast: 0.25 to 0.5 with such masks, 0.33 to 2 for the discs."""
LEAST_PART = 60
"""Smallest number of pixels of a moved part."""


def moved_objects(residual: Array, z: Array, noise: float) -> Mask:
    """Where something moved, (H, W), by residuals and photographs (P, C, H, W) and their noise."""
    local = np.sqrt(_mean((residual.astype(np.float64) ** 2).mean(axis=(0, 1)), WINDOW))
    contrast = np.sqrt(np.mean([_variance(one, WINDOW) for photograph in z for one in photograph], axis=0))
    moved = local > OVER_FRAME * np.median(local)
    moved &= (local > OVER_NOISE * noise) & (local > OF_CONTRAST * np.maximum(contrast, noise))
    parts, _ = label(moved)
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    return np.asarray(sizes[parts] >= LEAST_PART)


def largest(moved: Mask) -> tuple[slice, slice]:
    """Rows and columns of the largest moved part."""
    parts, _ = label(moved)
    sizes = np.bincount(parts.ravel())[1:]
    rows, columns = find_objects(parts)[int(sizes.argmax())]
    return rows, columns


def _mean(image: Array, window: int) -> Array:
    return np.asarray(uniform_filter(image, window, mode="reflect"))


def _variance(image: Array, window: int) -> Array:
    centred = image.astype(np.float64) - float(image.mean())
    return (_mean(centred**2, window) - _mean(centred, window) ** 2).clip(0)


# --- occlusion at depth edges ---
# The masks ignore it: each point's light is spread as if nothing stood in front. Within the reach of the blur, the side
# of the edge to which a pixel belongs, and its value, are then uncertain beyond the noise.

# Criteria for proximity to a depth edge, and the uncertainty there, from ray-traced scenes of two planes.
QUANTILE, BEYOND = 0.95, 1
"""Quantile of w over the frame whose widest mask gives the reach of an edge, and an additional margin in pixels."""
LEAST_STEP = 0.3
"""Change of w over that reach, pixels. With 0.3 and 0.5 pixels, 0.6 to 1.0 and 0.1 to 1.0 of the pixels that are wrong
by 0.3 pixels and three standard deviations are marked."""
STEEP = 0.55
"""Change relative to the change over twice the reach: a half for a slope, 1 for an edge."""
PICTURE = 1.7
"""Factor of the picture's error there over the estimate from noise and residual: 1.1 to 2.4."""


@dataclass(frozen=True)
class Occlusion:
    """Where occlusion is possible, (H, W), and the change of w about each pixel, (H, W)."""

    mask: Mask
    step: Array

    def spread(self, w_std: Array) -> Array:
        """Standard deviation of w (H, W), given that of noise: at an edge it includes both sides."""
        return np.where(self.mask, np.maximum(w_std, self.step / 2), w_std)


def occlusion_of(w: Array, stacks: Sequence[Masks]) -> Occlusion:
    """Regions of possible occlusion at the edges of a depth w (H, W), from the photographs' masks."""
    widest = float(np.quantile(w, QUANTILE))
    reach = max(half_size_at(stack, widest) for stack in stacks) + BEYOND
    step = span(w, 2 * reach + 1)
    return Occlusion((step > LEAST_STEP) & (step > STEEP * span(w, 4 * reach + 1)), step)
