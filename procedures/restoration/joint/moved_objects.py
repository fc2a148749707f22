"""Motion between the photographs: places that no common picture explains while it explains the rest.

Errors of the masks leave residuals everywhere, in proportion to the scene; noise is uniform. A moved object leaves its
own contrast, in one place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import find_objects, label, uniform_filter

from procedures.restoration.masks.blur_operator import Array

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class MovedSettings:
    """Criteria for motion.

    Attributes
    ----------
    window : int
        Side of a place, pixels.
    over_frame : float
        Local residual over the frame's median, root mean square: up to 1.5 with true masks, 2 with a mask rotated by 20
        degrees or the two masks exchanged, 4 for a disc of 33 pixels that moved by 3, 5 to 26 for discs that moved
        farther.
    over_noise, of_contrast : float
        Local residual over the noise, and over the photographs' contrast: 0.25 to 0.5 with such masks, 0.33 to 2 for
        the discs.
    least_part : int
        Smallest number of pixels.
        Pixels of one that counts.
    """

    window: int = 15
    over_frame: float = 3.5
    over_noise: float = 2.5
    of_contrast: float = 0.25
    least_part: int = 60


def moved_objects(residual: Array, z: Array, noise: float, s: MovedSettings | None = None) -> Mask:
    """Where something moved, (H, W).

    residual, z : (P, C, H, W) residuals of a restoration, and photographs; noise : standard deviation of these.
    """
    s = s or MovedSettings()
    local = np.sqrt(_mean((residual.astype(np.float64) ** 2).mean(axis=(0, 1)), s.window))
    contrast = np.sqrt(np.mean([_variance(one, s.window) for photograph in z for one in photograph], axis=0))
    moved = local > s.over_frame * np.median(local)
    moved &= (local > s.over_noise * noise) & (local > s.of_contrast * np.maximum(contrast, noise))
    parts, _ = label(moved)
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    return np.asarray(sizes[parts] >= s.least_part)


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
