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


@jitted(nogil=True, error_model="numpy")
def curves_chi_square(masks: Array, G: Array, g: Array, paths: Array, sigma: float) -> float:
    """d'G d - 2 g.d of the masks of paths (2, T, 2) at this size, of width `sigma`, less `masks` (2, K, K)."""
    d = np.empty(masks.shape)
    for k in range(2):
        d[k] = line_mask(paths[k], masks.shape[1] // 2, sigma) - masks[k]
    change = d.ravel()
    at = np.flatnonzero(change)
    there = change[at]
    return float(np.dot(there, np.dot(_part(G, at, at), there) - 2 * g[at]))


@jitted(nogil=True, error_model="numpy")
def add_curves(
    H: Array, gradient: Array, masks: Array, G: Array, g: Array, paths: Array, sigma: float,
    free: NDArray[np.int64], scale: float, begins: NDArray[np.int64], values: Array, points: int,
) -> None:  # fmt: skip
    """Add to normal matrix and gradient, over the x, then the y of the points of each free curve, at their own size.

    scale : of `paths` over the curves' own size; begins, values : see `line_mask_change`.
    """
    R, area, own = masks.shape[1] // 2, masks[0].size, 2 * points
    d = np.empty(masks.shape)
    changes, pixels = [np.zeros((0, own))][:0], [np.zeros(0, np.int64)][:0]
    for k in range(2):
        mask, at, change = line_mask_change(paths[k], R, sigma, begins, values, points)
        d[k] = mask - masks[k]
        changes.append(scale * change)
        pixels.append(at + k * area)
    change = d.ravel()
    changed = np.flatnonzero(change)
    for a in range(len(free)):
        at, left = pixels[free[a]], changes[free[a]].T
        mine = slice(a * own, (a + 1) * own)
        gradient[mine] += np.dot(left, np.dot(_part(G, at, changed), change[changed]) - g[at])
        for b in range(a, len(free)):
            block = np.dot(left, np.dot(_part(G, at, pixels[free[b]]), changes[free[b]]))
            H[mine, b * own : (b + 1) * own] += block
            if b > a:
                H[b * own : (b + 1) * own, mine] += block.T


@numba.njit(error_model="numpy")
def _part(G: Array, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Array:
    part = np.empty((len(rows), len(columns)))
    for i in range(len(rows)):
        for j in range(len(columns)):
            part[i, j] = G[rows[i], columns[j]]
    return part
