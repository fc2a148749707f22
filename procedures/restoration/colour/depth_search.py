"""Search for the depth on the sensor's grid, as the planes estimate it with a bias.

Each plane has only every other pixel. Where the blur is as small as its pixels it is aliased, which no blur explains,
and its w is too small by up to a half, without a visible residual. The complete mosaic is not affected: pictures
restored at several depths near the first one have the smallest residual at the right w.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter, uniform_filter

from procedures.restoration.colour.picture import MosaicTerm, alone
from procedures.restoration.masks.blur_operator import Array

STEP = 0.3
"""Step of the depths tried, pixels of the sensor."""
OFFSETS = (-1, 0, 1, 2, 3)
"""Depths tried, in steps from the first one, which aliasing makes too small."""
SURE = 0.1
"""Changes of w up to this are left to the joint steps, pixels, as the windows do not follow slopes and edges."""
WINDOW = 31
"""Side of the windows in which w is changed as one, pixels of the sensor."""


def searched(data: MosaicTerm, u: Array, w: Array, sigma: float) -> tuple[Array, Array]:
    """w (H, W) of the smallest residual of the mosaics, and the uncertainty of the first w.

    u : (3, H', W'), initial picture.
    """
    limit, R = min(blur.stack.max_w for blur in data.blurs), data.R
    residuals = []
    for offset in OFFSETS:
        wide = np.clip(np.pad(w + offset * STEP, R, mode="edge"), 0, limit).astype(u.dtype)
        picture = alone(data, u, wide, sigma, 2, 20)
        residuals.append(uniform_filter((data.residual(picture) ** 2).sum(axis=(0, 1)), WINDOW))
    move = STEP * gaussian_filter(OFFSETS[0] + _lowest(np.stack(residuals)), WINDOW / 3)
    better = np.clip(w + move - np.clip(move, -SURE, SURE), 0, limit)
    return np.asarray(better), np.asarray(np.sqrt(gaussian_filter(move**2, WINDOW / 3)))


def _lowest(costs: Array) -> Array:
    """Position of the minimum of costs (N, H, W) along the first axis, refined by a parabola through three samples."""
    middle = np.clip(costs.argmin(axis=0), 1, len(costs) - 2)
    before, at, after = (np.take_along_axis(costs, (middle + n)[None], axis=0)[0] for n in (-1, 0, 1))
    bend = np.maximum(before - 2 * at + after, 1e-30)
    return np.asarray(middle + np.clip((before - after) / (2 * bend), -1, 1))
