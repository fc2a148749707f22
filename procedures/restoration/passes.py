"""Single passes over whole arrays, on all threads, where NumPy would take one for every operation in them."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]

MOST_THREADS = numba.get_num_threads()
# on a busy machine a pass waits for its last thread longer than it works, unless that takes milliseconds
NUMBERS_PER_THREAD = 4_000_000
BLOCK = 8192


def take_threads(numbers: int) -> None:
    """Let the next pass over so many numbers use the threads that are worth waking."""
    numba.set_num_threads(min(MOST_THREADS, 1 + numbers // NUMBERS_PER_THREAD))


def advance(x: Array, r: Array, p: Array, q: Array, step: float) -> None:
    """x + step p and r - step q, in place; contiguous arrays of one shape."""
    take_threads(x.size)
    _advance(x.ravel(), r.ravel(), p.ravel(), q.ravel(), x.dtype.type(step))


def turn(p: Array, y: Array, part: float) -> None:
    """part p + y in place of p."""
    take_threads(p.size)
    _turn(p.ravel(), y.ravel(), p.dtype.type(part))


def add_diffusion(
    out: Array, x: Array, weight: float = 1.0, down: Array | float = 1.0, across: Array | float = 1.0
) -> None:
    """Add weight times the gradient of half the weighted sum of x's squared differences, -div(g grad x) of (6.3).

    out, x : (..., H, W), contiguous; down, across : weights of differences, (H - 1, W) and (H, W - 1), or of all.
    """
    take_threads(x.size)
    flat = (-1, *x.shape[-2:])
    g, h = _rows(down, x.shape[-1], x.dtype), _rows(across, x.shape[-1] - 1, x.dtype)
    _add_diffusion(out.reshape(flat), x.reshape(flat), x.dtype.type(weight), g, h)


def gaussian(a: Array, sigma: float, truncate: float) -> Array:
    """a (H, W) under a Gaussian window of `sigma` pixels cut at `truncate` sigma, continued evenly beyond the frame."""
    take_threads(a.size * int(truncate * sigma))
    reach = int(truncate * sigma + 0.5)
    half = np.exp(-0.5 * (np.arange(reach + 1) / sigma) ** 2)
    half /= 2 * half.sum() - 1
    return np.asarray(_window_across(_window_down(np.ascontiguousarray(a), half.astype(a.dtype)), half.astype(a.dtype)))


def _rows(weights: Array | float, width: int, dtype: Any) -> Array:
    """Weights as rows; one row stands for all of them."""
    return np.full((1, width), weights, dtype) if np.ndim(weights) == 0 else np.ascontiguousarray(weights, dtype)


@numba.njit(parallel=True, fastmath=True, cache=True)
def _advance(x: Array, r: Array, p: Array, q: Array, step: Any) -> None:
    for block in numba.prange(-(-x.size // BLOCK)):
        for n in range(block * BLOCK, min((block + 1) * BLOCK, x.size)):
            x[n] += step * p[n]
            r[n] -= step * q[n]


@numba.njit(parallel=True, fastmath=True, cache=True)
def _turn(p: Array, y: Array, part: Any) -> None:
    for block in numba.prange(-(-p.size // BLOCK)):
        for n in range(block * BLOCK, min((block + 1) * BLOCK, p.size)):
            p[n] = part * p[n] + y[n]


@numba.njit(parallel=True, fastmath=True, cache=True)
def _add_diffusion(out: Array, x: Array, weight: Any, down: Array, across: Array) -> None:
    channels, height, width = x.shape
    for n in numba.prange(channels * height):
        c, i = n // height, n % height
        row, to = x[c, i], out[c, i]
        if i > 0:
            other, g = x[c, i - 1], down[min(i - 1, down.shape[0] - 1)]
            for j in range(width):
                to[j] += weight * g[j] * (row[j] - other[j])
        if i < height - 1:
            other, g = x[c, i + 1], down[min(i, down.shape[0] - 1)]
            for j in range(width):
                to[j] += weight * g[j] * (row[j] - other[j])
        g = across[min(i, across.shape[0] - 1)]
        for j in range(width - 1):
            to[j] += weight * g[j] * (row[j] - row[j + 1])
        for j in range(1, width):
            to[j] += weight * g[j - 1] * (row[j] - row[j - 1])


@numba.njit(parallel=True, fastmath=True, cache=True)
def _window_down(a: Array, half: Array) -> Array:
    height, width = a.shape
    out = np.empty_like(a)
    for i in numba.prange(height):
        row = out[i]
        for j in range(width):
            row[j] = half[0] * a[i, j]
        for t in range(1, half.size):
            part, above, below = half[t], a[max(i - t, 0)], a[min(i + t, height - 1)]
            for j in range(width):
                row[j] += part * (above[j] + below[j])
    return out


@numba.njit(parallel=True, fastmath=True, cache=True)
def _window_across(a: Array, half: Array) -> Array:
    height, width = a.shape
    reach = half.size - 1
    out = np.empty_like(a)
    for i in numba.prange(height):
        wide = np.empty(width + 2 * reach, a.dtype)
        wide[:reach], wide[reach : reach + width], wide[reach + width :] = a[i, 0], a[i], a[i, -1]
        row = out[i]
        for j in range(width):
            row[j] = half[0] * wide[reach + j]
        for t in range(1, half.size):
            part, left, right = half[t], wide[reach - t : reach - t + width], wide[reach + t : reach + t + width]
            for j in range(width):
                row[j] += part * (left[j] + right[j])
    return out
