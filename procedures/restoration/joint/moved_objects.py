"""Motion between the photographs: places that no common picture explains while it explains the rest.

Errors of the masks leave residuals everywhere, in proportion to the scene; noise is uniform. A moved object leaves its
own contrast, in one place.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import find_objects, label, uniform_filter

from procedures.numerics.arrays import Mask
from procedures.restoration.masks.blur_operator import Array

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
    """Where something moved, (H, W).

    residual, z : (P, C, H, W) residuals of a restoration, and photographs; noise : standard deviation of these.
    """
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
    return np.asarray(uniform_filter(image, window, mode="nearest"))


def _variance(image: Array, window: int) -> Array:
    centred = image.astype(np.float64) - float(image.mean())
    return (_mean(centred**2, window) - _mean(centred, window) ** 2).clip(0)
