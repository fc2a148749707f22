"""Beside steps of depth, where a near thing hides a part of what lies behind it from a part of the lens or of the path.

The masks know nothing of that: each point's light is spread as if nothing stood before it. Which side of a step a
pixel is of, and what it looks like, is then uncertain within the reach of the blur, whatever noise says of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.masks.mask_fields import Masks

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class OcclusionSettings:
    """What counts as beside a step of depth, and how uncertain it is there, by traced light of two flats.

    Attributes
    ----------
    quantile, beyond : float
        Of w over the frame, whose widest mask a step reaches as far as; and by how many pixels farther.
    least_step : float
        Change of w over that reach, pixels. With 0.3 and 0.5 pixels 0.6 to 1.0 and 0.1 to 1.0 of what is wrong by 0.3
        pixels and three standard deviations is named.
    steep : float
        That change over the one of twice the reach: of a slope it is a half, of a step 1.
    picture : float
        Error of the picture there over that which noise and what is left over tell: 1.1 to 2.4.
    """

    quantile: float = 0.95
    beyond: int = 1
    least_step: float = 0.3
    steep: float = 0.55
    picture: float = 1.7


@dataclass(frozen=True)
class Occlusion:
    """Where one thing may hide another, (H, W), and by how much w changes about each pixel, (H, W)."""

    mask: Mask
    step: Array

    @classmethod
    def nowhere(cls, shape: tuple[int, int]) -> Occlusion:
        """Of a flat scene."""
        return cls(np.zeros(shape, bool), np.zeros(shape))

    def spread(self, w_std: Array) -> Array:
        """Standard deviation of w (H, W), where that of noise is known: beside a step it is of either side."""
        return np.where(self.mask, np.maximum(w_std, self.step / 2), w_std)


def occlusion_of(w: Array, stacks: Sequence[Masks], s: OcclusionSettings | None = None) -> Occlusion:
    """Beside which steps of a depth w (H, W) one thing may hide another, by the photographs' masks."""
    s = s or OcclusionSettings()
    widest = float(np.quantile(w, s.quantile))
    supports = [(one.supports(), one.step) for one in stacks]
    reach = max(int(wide[min(int(widest / step) + 1, len(wide) - 1)]) for wide, step in supports) + s.beyond
    step = _span(w, reach)
    return Occlusion((step > s.least_step) & (step > s.steep * _span(w, 2 * reach)), step)


def _span(w: Array, reach: int) -> Array:
    """Greatest less least of w within so many pixels."""
    side = 2 * reach + 1
    return np.asarray(maximum_filter(w, side) - minimum_filter(w, side))
