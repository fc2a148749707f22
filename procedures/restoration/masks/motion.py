"""Mask of the image curve of a scene point during the exposure (5.2)."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter

from procedures.numerics.arrays import Array
from procedures.outcome import BadInput


def path_mask(path_px: Array, R: int, *, softness_px: float = 0.3) -> Array:
    """Mask (2R + 1, 2R + 1), sum 1, of a curve (n, 2) in pixels relative to its point: equation (5.2).

    Each instant is distributed linearly over four pixels, then blurred by the pixel's aperture `softness_px`.

    Raises BadInput if the curve leaves the mask.
    """
    if not np.abs(path_px).max() <= R - 1:  # nor where it is NaN
        raise BadInput(
            f"the motion of {np.abs(path_px).max():.1f} pixels leaves masks of half-size {R}", "raise --max-w"
        )
    out = np.zeros((2 * R + 1, 2 * R + 1))
    x, y = path_px[:, 0] + R, path_px[:, 1] + R
    i, j = np.floor(y).astype(int), np.floor(x).astype(int)
    fy, fx = y - i, x - j
    for di, wy in ((0, 1 - fy), (1, fy)):
        for dj, wx in ((0, 1 - fx), (1, fx)):
            np.add.at(out, (i + di, j + dj), wy * wx)
    out = gaussian_filter(out, softness_px, mode="constant")
    return np.asarray(out / out.sum())
