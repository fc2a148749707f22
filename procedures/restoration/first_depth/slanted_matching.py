"""Surfaces that slope, for matching: penalties on changes between levels would make terraces of them.

Levels counted from a sloping surface instead of from zero let a slope be no change. The surface is the plane through
the depths around each pixel that are near its own, so that it does not bend at depth steps.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from procedures.numerics.kernel_cache import jitted
from procedures.restoration.first_depth.segments import continued
from procedures.restoration.masks.blur_operator import Array

# every so many pixels along both axes carry the planes: they are much wider
SPARSE = 3


def local_planes(w: Array, sigma: float, near: float) -> Array:
    """At each pixel of w (H, W), the plane through the depths around it.

    sigma : of the Gaussian window, pixels; near : standard deviation of differences of depth that still belong to one
    surface, pixels of w (bilateral weights).
    """
    H, W = w.shape
    wide = np.pad(w, ((0, -H % SPARSE), (0, -W % SPARSE)), mode="edge")
    sparse = np.ascontiguousarray(wide[SPARSE // 2 :: SPARSE, SPARSE // 2 :: SPARSE], dtype=np.float64)
    step = 0.7 * near
    place = (w - sparse.min()) / step
    found = np.zeros((H, W))
    for k in range(int(place.max()) + 2):
        counts = np.clip(1 - np.abs(place - k), 0, None)
        if not counts.any():
            continue
        alike = np.exp(-0.5 * ((sparse - (sparse.min() + k * step)) / near) ** 2)
        plane = cv2.resize(continued(sparse, alike, sigma / SPARSE), wide.shape[::-1], interpolation=cv2.INTER_LINEAR)
        found += counts * plane[:H, :W]
    return found


@jitted(nogil=True)
def sheared(volume: NDArray[np.float32], first: Array, levels: int, beyond: float) -> NDArray[np.float32]:
    """The cost volume (H, W, L) counted from a surface: (H, W, levels), interpolated linearly.

    first : (H, W), the surface's first level in levels of the volume; beyond : cost outside the volume.
    """
    height, width, known = volume.shape
    out = np.empty((height, width, levels), np.float32)
    for y in range(height):
        for x in range(width):
            least = int(np.floor(first[y, x]))
            part = np.float32(first[y, x] - least)
            for n in range(levels):
                k = least + n
                below = volume[y, x, k] if 0 <= k < known else np.float32(beyond)
                above = volume[y, x, k + 1] if 0 <= k + 1 < known else np.float32(beyond)
                out[y, x, n] = below + part * (above - below)
    return out
