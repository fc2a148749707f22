"""Evidence of one size on two curves, and its derivatives, compiled, as thousands of curves are tried.

Curves touch few pixels of their masks, so that most of a matrix over all pixels is not read.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from procedures.numerics.compiled import jitted
from procedures.restoration.masks.line_rasterisation import line_mask, line_mask_change

Array = NDArray[np.floating[Any]]


@jitted(nogil=True, fastmath=True, error_model="numpy")
def curves_chi_square(masks: Array, G: Array, g: Array, paths: Array, sigma: float) -> float:
    """d'G d - 2 g.d of the masks of paths (2, T, 2) at this size, of width `sigma`, less `masks` (2, K, K)."""
    size = masks.shape[1]
    difference, at, count = np.empty(masks.size), np.empty(masks.size, np.int64), 0
    for k in range(2):
        mask = line_mask(paths[k], size // 2, sigma)
        for i in range(size):
            for j in range(size):
                change = mask[i, j] - masks[k, i, j]
                if change != 0:
                    difference[count], at[count] = change, (k * size + i) * size + j
                    count += 1
    value = 0.0
    for m in range(count):
        value += difference[m] * (_times(G, at[m], at, difference, count) - 2 * g[at[m]])
    return value


@jitted(nogil=True, fastmath=True, error_model="numpy")
def add_curves(
    H: Array, gradient: Array, masks: Array, G: Array, g: Array, paths: Array, sigma: float,
    free: NDArray[np.int64], scale: float, begins: NDArray[np.int64], values: Array, points: int,
) -> None:  # fmt: skip
    """Add to normal matrix and gradient, over the x, then the y of the points of each free curve, at their own size.

    Entries below the matrix's diagonal blocks are omitted, as it is symmetric.
    scale : of `paths` relative to the curves; begins, values : see `line_mask_change`.
    """
    size, unknowns = masks.shape[1], 2 * points
    area = size * size
    difference, at, total = np.empty(2 * area), np.empty(2 * area, np.int64), 0
    changes, pixels, count = np.empty((2, area, unknowns)), np.empty((2, area), np.int64), np.zeros(2, np.int64)
    for k in range(2):
        mask, those, rows = line_mask_change(paths[k], size // 2, sigma, begins, values, points)
        for i in range(size):
            for j in range(size):
                change = mask[i, j] - masks[k, i, j]
                if change != 0:
                    difference[total], at[total] = change, (k * size + i) * size + j
                    total += 1
        count[k] = len(those)
        for n in range(len(those)):
            pixels[k, n] = k * area + those[n]
            for m in range(unknowns):
                changes[k, n, m] = scale * rows[n, m]
    row = np.empty(unknowns)
    for a in range(len(free)):
        for n in range(count[free[a]]):
            pixel, mine = pixels[free[a], n], changes[free[a], n]
            downhill = _times(G, pixel, at, difference, total) - g[pixel]
            for m in range(unknowns):
                gradient[a * unknowns + m] += mine[m] * downhill
            for b in range(a, len(free)):
                row[:] = 0.0
                for q in range(count[free[b]]):
                    factor = G[pixel, pixels[free[b], q]]
                    for m in range(unknowns):
                        row[m] += factor * changes[free[b], q, m]
                for k in range(unknowns):
                    if mine[k] != 0:  # a pixel depends on few of its curve's points
                        for m in range(unknowns):
                            H[a * unknowns + k, b * unknowns + m] += mine[k] * row[m]


@numba.njit(fastmath=True, error_model="numpy")
def _times(G: Array, row: int, at: NDArray[np.int64], values: Array, number: int) -> float:
    """A row of G times values (number,) in the columns `at`."""
    total = 0.0
    for m in range(number):
        total += G[row, at[m]] * values[m]
    return total
