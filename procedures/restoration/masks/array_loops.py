"""Single-pass loops over arrays, where NumPy would take one pass per operation; threads for large work."""

import ctypes
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import pairwise
from threading import Thread
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from procedures.numerics.compiled import jitted

Array = NDArray[np.floating[Any]]

NUMBERS_PER_THREAD = 20_000_000
"""Numbers per thread: work of some milliseconds, for which starting a thread pays off."""


TRIM_THRESHOLD, MMAP_THRESHOLD, MMAP_MAX = -1, -3, -4
"""Options of glibc's mallopt."""
PASSES = 40
"""Numbers for each number of a loop that is bound by memory."""


def most_threads() -> int:
    """Threads that the calling thread may use: numba's number, which parallel workers set to one."""
    return int(numba.get_num_threads())


def threads_for(parts: int) -> int:
    """Threads for work that may be divided into so many parts; small work does not ask for numba's number, which takes
    0.02 ms."""
    return 1 if parts <= 1 else min(parts, most_threads())


def in_bands(work: Callable[[int, int], object], limits: Iterable[int]) -> None:
    """Run work(top, bottom) between all neighbouring limits, one thread each; `work` must release the interpreter."""
    first, *others = pairwise(limits)
    threads = [Thread(target=work, args=band) for band in others]
    for thread in threads:
        thread.start()
    work(*first)
    for thread in threads:
        thread.join()


@contextmanager
def kept_memory() -> Iterator[None]:
    """Context in which the memory of freed arrays serves the next ones: glibc returns that of large arrays to the
    system, and each new page of a fresh array then costs a fault."""
    library = ctypes.CDLL(None) if sys.platform == "linux" else None
    mallopt, trim = (getattr(library, name, lambda *options: 0) for name in ("mallopt", "malloc_trim"))
    mallopt(MMAP_MAX, 0)
    mallopt(TRIM_THRESHOLD, -1)
    try:
        yield
    finally:
        for option, value in ((MMAP_MAX, 65536), (MMAP_THRESHOLD, 2**25), (TRIM_THRESHOLD, 2**26)):
            mallopt(option, value)
        trim(0)


def bands_of(rows: int, numbers: int) -> list[int]:
    """Limits of bands of rows for an amount of work."""
    count = threads_for(numbers // NUMBERS_PER_THREAD)
    return [rows * k // count for k in range(count + 1)]


def advance(x: Array, r: Array, p: Array, q: Array, step: float) -> None:
    """x + step p and r - step q, in place; contiguous arrays of one shape."""
    at = (x.ravel(), r.ravel(), p.ravel(), q.ravel(), x.dtype.type(step))
    in_bands(partial(_advance, *at), bands_of(x.size, PASSES * x.size))


def turn(p: Array, y: Array, part: float) -> None:
    """part p + y in place of p."""
    at = (p.ravel(), y.ravel(), p.dtype.type(part))
    in_bands(partial(_turn, *at), bands_of(p.size, PASSES * p.size))


def add_diffusion(
    out: Array, x: Array, weight: float = 1.0, down: Array | float = 1.0, across: Array | float = 1.0
) -> None:
    """Add weight times -div(g grad x) of (6.3) to out; x : (..., H, W); down, across : g of differences, or of all."""
    flat = (-1, *x.shape[-2:])
    g, h = _rows(down, x.shape[-1], x.dtype), _rows(across, x.shape[-1] - 1, x.dtype)
    at = (out.reshape(flat), x.reshape(flat), x.dtype.type(weight), g, h)
    in_bands(partial(_add_diffusion, *at), bands_of(x.shape[-2], PASSES * x.size))


def add_bending(out: Array, x: Array, weight: float, down: Array | float, across: Array | float) -> None:
    """Add weight times the gradient of half the weighted sum of x's squared second differences.

    Along both axes and, with factor two, mixed: for constant weights, the Laplacian squared. out, x : (H, W);
    down, across : weights of differences as for `add_diffusion`; a second difference has the smallest of its weights.
    """
    g, h = _every_row(down, x), _every_row(across, x[:, 1:])
    at = (out, x, x.dtype.type(weight), g[: len(x) - 1], h)
    in_bands(partial(_add_bending, *at), bands_of(len(x), 2 * PASSES * x.size))


def _rows(weights: Array | float, width: int, dtype: Any) -> Array:
    """Weights as rows; one row for a constant."""
    return np.full((1, width), weights, dtype) if np.ndim(weights) == 0 else np.ascontiguousarray(weights, dtype)


def _every_row(weights: Array | float, like: Array) -> Array:
    """Weights as an array with one row per row of `like`."""
    return np.full(like.shape, weights, like.dtype) if np.ndim(weights) == 0 else np.asarray(weights, like.dtype)


@jitted(fastmath=True, nogil=True)
def _advance(x: Array, r: Array, p: Array, q: Array, step: Any, top: int, bottom: int) -> None:
    for n in range(top, bottom):
        x[n] += step * p[n]
        r[n] -= step * q[n]


@jitted(fastmath=True, nogil=True)
def _turn(p: Array, y: Array, part: Any, top: int, bottom: int) -> None:
    for n in range(top, bottom):
        p[n] = part * p[n] + y[n]


@jitted(fastmath=True, nogil=True)
def _add_diffusion(out: Array, x: Array, weight: Any, down: Array, across: Array, top: int, bottom: int) -> None:
    channels, height, width = x.shape
    for c in range(channels):
        for i in range(top, bottom):
            row, to = x[c, i], out[c, i]
            for k in (i - 1, i + 1):
                if 0 <= k < height:
                    other, g = x[c, k], down[min(min(i, k), down.shape[0] - 1)]
                    for j in range(width):
                        to[j] += weight * g[j] * (row[j] - other[j])
            g = across[min(i, across.shape[0] - 1)]
            for j in range(width - 1):
                to[j] += weight * g[j] * (row[j] - row[j + 1])
            for j in range(1, width):
                to[j] += weight * g[j - 1] * (row[j] - row[j - 1])


@jitted(fastmath=True, nogil=True)
def _add_bending(out: Array, x: Array, weight: Any, down: Array, across: Array, top: int, bottom: int) -> None:
    height, width = x.shape
    one, two = x.dtype.type(1), x.dtype.type(2)
    e = np.zeros(width + 1, x.dtype)  # a row at a time, so that loops are vectorised
    for i in range(top, bottom):
        row, to, g = x[i], out[i], across[i]
        e[0] = e[width - 1] = 0
        for j in range(1, width - 1):
            e[j] = weight * min(g[j - 1], g[j]) * (row[j - 1] - two * row[j] + row[j + 1])
        to[0] += e[1]
        for j in range(1, width):
            to[j] += e[j - 1] - two * e[j] + e[j + 1]
    for i in range(max(top - 1, 1), min(bottom + 1, height - 1)):
        above, row, below, upper, lower = x[i - 1], x[i], x[i + 1], down[i - 1], down[i]
        for j in range(width):
            e[j] = weight * min(upper[j], lower[j]) * (above[j] - two * row[j] + below[j])
        for k, part in ((i - 1, one), (i, -two), (i + 1, one)):
            if top <= k < bottom:
                to = out[k]
                for j in range(width):
                    to[j] += part * e[j]
    for i in range(max(top - 1, 0), min(bottom, height - 1)):
        row, below, upper, left, lower = x[i], x[i + 1], down[i], across[i], across[i + 1]
        for j in range(width - 1):
            g = min(min(upper[j], upper[j + 1]), min(left[j], lower[j]))
            e[j] = two * weight * g * (row[j] - row[j + 1] - below[j] + below[j + 1])
        e[width - 1] = 0
        for k, sign in ((i, one), (i + 1, -one)):
            if top <= k < bottom:
                to = out[k]
                to[0] += sign * e[0]
                for j in range(1, width):
                    to[j] += sign * (e[j] - e[j - 1])
