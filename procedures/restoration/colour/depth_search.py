"""Depth looked for again on the sensor's grid, where the planes told it wrongly.

Each plane has every other pixel only: of a blur as small as its pixels it shows aliases, which no blur explains, and
its w comes out by up to half too small, with nothing left over that tells. The mosaic itself is not fooled: pictures
restored at depths beside the first one leave least over where w is right.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter, uniform_filter

from procedures.restoration.colour.picture import MosaicTerm, alone
from procedures.restoration.masks.blur_operator import Array

STEP = 0.3
"""Between depths that are tried, pixels of the sensor."""
OFFSETS = (-1, 0, 1, 2, 3)
"""Depths tried, in steps from the first: aliases make w too small."""
SURE = 0.1
"""Moves of w up to this are left to the joint steps, pixels: windows know less of slopes and steps than w does."""
WINDOW = 31
"""Side of the places whose w is moved as one, pixels of the sensor."""


def searched(
    data: MosaicTerm, u: Array, w: Array, sigma: float, rounds: int = 2, iterations: int = 20
) -> tuple[Array, Array]:
    """w (H, W) where the mosaics are explained best by pictures of their own, and how far off the first w may be.

    u : (3, H', W') to begin with.
    """
    limit, R = min(blur.stack.max_w for blur in data.blurs), data.R
    left = []
    for offset in OFFSETS:
        wide = np.clip(np.pad(w + offset * STEP, R, mode="edge"), 0, limit).astype(u.dtype)
        found = alone(data, u, wide, sigma, rounds, iterations)
        left.append(uniform_filter((data.residual(found) ** 2).sum(axis=(0, 1)), WINDOW))
    move = STEP * gaussian_filter(OFFSETS[0] + _lowest(np.stack(left)), WINDOW / 3)
    better = np.clip(w + move - np.clip(move, -SURE, SURE), 0, limit)
    return np.asarray(better), np.asarray(np.sqrt(gaussian_filter(move**2, WINDOW / 3)))


def _lowest(costs: Array) -> Array:
    """Place along the first axis of the least of costs (N, H, W), between samples by the parabola through three."""
    middle = np.clip(costs.argmin(axis=0), 1, len(costs) - 2)
    before, at, after = (np.take_along_axis(costs, (middle + n)[None], axis=0)[0] for n in (-1, 0, 1))
    bend = np.maximum(before - 2 * at + after, 1e-30)
    return np.asarray(middle + np.clip((before - after) / (2 * bend), -1, 1))
