"""The two inner loops of space-variant blur: spread coefficients over masks, gather masks from errors.

Both take two neighbouring masks per pixel, which serves the interpolated mask, its adjoint and its derivative alike.
No pixel allocates, mask rows are padded to whole vectors, and bands of the output are independent of each other.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

VECTOR = 8
# a band's first and last 2R rows are visited twice, so bands are tall; short enough for two cores to share a photograph
BAND = 32


@numba.njit(parallel=True, fastmath=True, cache=True)
def spread(
    a: NDArray[np.floating],
    b: NDArray[np.floating],
    level: NDArray[np.int32],
    masks: NDArray[np.floating],
    radius: NDArray[np.int32],
    out: NDArray[np.floating],
) -> None:
    """Sum over pixels of a * masks[level] + b * masks[level + 1], each placed at its pixel.

    a, b, level : (H + 2R, W + 2R), pixels of negative level take no part; masks : (L, 2R + 1, multiple of 8);
    radius : (L,) support of each mask, increasing; out : (H, at least W + 4R + 8), whose columns 2R .. 2R + W are the
    photograph's.
    """
    size = masks.shape[1]
    R = size // 2
    height = out.shape[0]
    for n in numba.prange((height + BAND - 1) // BAND):
        top = n * BAND
        bottom = min(height, top + BAND)
        out[top:bottom] = 0
        for i in range(top, bottom + 2 * R):
            for j in range(a.shape[1]):
                k = level[i, j]
                if k < 0:
                    continue
                r = radius[k + 1]
                p, q = a[i, j], b[i, j]
                start = (R - r) // VECTOR * VECTOR
                stop = (R + r) // VECTOR * VECTOR + VECTOR
                for ky in range(max(R - r, top - i + 2 * R), min(R + r + 1, bottom - i + 2 * R)):
                    row = out[i - 2 * R + ky, j + start : j + stop]
                    low = masks[k, ky, start:stop]
                    high = masks[k + 1, ky, start:stop]
                    for t in range(stop - start):
                        row[t] += p * low[t] + q * high[t]


@numba.njit(parallel=True, fastmath=True, cache=True)
def gather(
    e: NDArray[np.floating],
    level: NDArray[np.int32],
    masks: NDArray[np.floating],
    radius: NDArray[np.int32],
    low: NDArray[np.floating],
    high: NDArray[np.floating],
) -> None:
    """Products of the errors around each pixel with its two neighbouring masks: the adjoint of `spread`.

    e : (H + 4R, at least W + 4R + 8), zero outside the photograph, which begins at (2R, 2R);
    level, low, high : (H + 2R, W + 2R).
    """
    size = masks.shape[1]
    R = size // 2
    for i in numba.prange(level.shape[0]):
        for j in range(level.shape[1]):
            k = level[i, j]
            low[i, j] = high[i, j] = 0
            if k < 0:
                continue
            r = radius[k + 1]
            start = (R - r) // VECTOR * VECTOR
            stop = (R + r) // VECTOR * VECTOR + VECTOR
            p = e.dtype.type(0)
            q = e.dtype.type(0)
            for ky in range(R - r, R + r + 1):
                around = e[i + ky, j + start : j + stop]
                m0 = masks[k, ky, start:stop]
                m1 = masks[k + 1, ky, start:stop]
                for t in range(stop - start):
                    p += around[t] * m0[t]
                    q += around[t] * m1[t]
            low[i, j] = p
            high[i, j] = q
