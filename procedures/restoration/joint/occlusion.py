"""Occlusion at depth edges, where a near object hides a part of the background from a part of the lens or of the path.

The masks ignore it: each point's light is spread as if nothing stood in front. Within the reach of the blur, the side
of the edge to which a pixel belongs, and its value, are then uncertain beyond the noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from procedures.numerics.arrays import Mask
from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.masks.mask_fields import Masks, half_size_at

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

    @classmethod
    def nowhere(cls, shape: tuple[int, int]) -> Occlusion:
        """The occlusion of a flat scene."""
        return cls(np.zeros(shape, bool), np.zeros(shape))

    def spread(self, w_std: Array) -> Array:
        """Standard deviation of w (H, W), given that of noise: at an edge it includes both sides."""
        return np.where(self.mask, np.maximum(w_std, self.step / 2), w_std)


def occlusion_of(w: Array, stacks: Sequence[Masks]) -> Occlusion:
    """Regions of possible occlusion at the edges of a depth w (H, W), from the photographs' masks."""
    widest = float(np.quantile(w, QUANTILE))
    reach = max(half_size_at(one, widest) for one in stacks) + BEYOND
    step = _span(w, reach)
    return Occlusion((step > LEAST_STEP) & (step > STEEP * _span(w, 2 * reach)), step)


def _span(w: Array, reach: int) -> Array:
    side = 2 * reach + 1
    return np.asarray(maximum_filter(w, side) - minimum_filter(w, side))
