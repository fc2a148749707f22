"""What one size's evidence says of two curves and of their changes, compiled: thousands of curves are tried.

Curves touch few pixels of their masks, so that most of a matrix over all of them is not read.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from procedures.numerics.kernel_cache import jitted
from procedures.restoration.masks.line_rasterisation import line_mask, line_mask_change

Array = NDArray[np.floating[Any]]


@jitted(nogil=True, fastmath=True, error_model="numpy")
def curves_chi_square(masks: Array, G: Array, g: Array, paths: Array, sigma: float) -> float:
    """d'G d - 2 g.d of the masks of paths (2, T, 2) at this size, of width `sigma`, less `masks` (2, K, K)."""
    size = masks.shape[1]
    there, at, found = np.empty(masks.size), np.empty(masks.size, np.int64), 0
    for k in range(2):
        mask = line_mask(paths[k], size // 2, sigma)
        for i in range(size):
            for j in range(size):
                change = mask[i, j] - masks[k, i, j]
                if change != 0:
                    there[found], at[found] = change, (k * size + i) * size + j
                    found += 1
    value = 0.0
    for m in range(found):
        value += there[m] * (_times(G, at[m], at, there, found) - 2 * g[at[m]])
    return value


@jitted(nogil=True, fastmath=True, error_model="numpy")
def add_curves(
    H: Array, gradient: Array, masks: Array, G: Array, g: Array, paths: Array, sigma: float,
    free: NDArray[np.int64], scale: float, begins: NDArray[np.int64], values: Array, points: int,
) -> None:  # fmt: skip
    """Add to normal matrix and gradient, over the x, then the y of the points of each free curve, at their own size.

    What lies below the matrix's diagonal blocks is left out, as it is symmetric.
    scale : of `paths` over the curves' own size; begins, values : see `line_mask_change`.
    """
    size, own = masks.shape[1], 2 * points
    area = size * size
    there, at, found = np.empty(2 * area), np.empty(2 * area, np.int64), 0
    changes, pixels, count = np.empty((2, area, own)), np.empty((2, area), np.int64), np.zeros(2, np.int64)
    for k in range(2):
        mask, those, rows = line_mask_change(paths[k], size // 2, sigma, begins, values, points)
        for i in range(size):
            for j in range(size):
                change = mask[i, j] - masks[k, i, j]
                if change != 0:
                    there[found], at[found] = change, (k * size + i) * size + j
                    found += 1
        count[k] = len(those)
        for n in range(len(those)):
            pixels[k, n] = k * area + those[n]
            for m in range(own):
                changes[k, n, m] = scale * rows[n, m]
    row = np.empty(own)
    for a in range(len(free)):
        for n in range(count[free[a]]):
            pixel, mine = pixels[free[a], n], changes[free[a], n]
            downhill = _times(G, pixel, at, there, found) - g[pixel]
            for m in range(own):
                gradient[a * own + m] += mine[m] * downhill
            for b in range(a, len(free)):
                row[:] = 0.0
                for q in range(count[free[b]]):
                    beside = G[pixel, pixels[free[b], q]]
                    for m in range(own):
                        row[m] += beside * changes[free[b], q, m]
                for k in range(own):
                    if mine[k] != 0:  # a pixel is moved by few of its curve's points
                        for m in range(own):
                            H[a * own + k, b * own + m] += mine[k] * row[m]


@numba.njit(fastmath=True, error_model="numpy")
def _times(G: Array, row: int, at: NDArray[np.int64], values: Array, number: int) -> float:
    """A row of G times values (number,) in the columns `at`."""
    total = 0.0
    for m in range(number):
        total += G[row, at[m]] * values[m]
    return total
