"""Rasterisation of a thin line from samples, consistent with the masks of shapes, and its derivative.

Masks of shapes are sums of samples (`blur_models.mask`), and a line narrower than the samples' spacing gets more or
less light depending on its position: masks of curves must have the same errors, or fitted curves bend to compensate
them. A point of the line touches few pixels and depends on few control points, so that one pass over it suffices.
"""

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from procedures.numerics.compiled import jitted
from procedures.outcome import BadInput
from procedures.restoration.masks.blur_models import SAMPLES

Array = NDArray[np.floating[Any]]

TAIL = 5.0
"""Half-width of the line's support, in widths of the line."""
APERTURE_PX = 0.3
CUBIC = 4
"""Control points that an instant of a cubic spline depends on."""


@jitted(nogil=True, error_model="numpy")
def line_mask(path: Array, R: int, sigma: float) -> Array:
    """Mask (2R + 1, 2R + 1) of a path (T, 2) at equal times, a line of width sigma, of sum 1 less the light outside."""
    size = 2 * R + 1
    out, across, down = np.zeros((size, size)), np.zeros(size), np.zeros(size)
    whole, slower = 0.0, np.exp(-1 / (SAMPLES * sigma) ** 2)
    for t in range(len(path)):
        left, right, light = _shares(path[t, 0], R, sigma, slower, across)
        top, bottom, more = _shares(path[t, 1], R, sigma, slower, down)
        whole += light * more
        for i in range(top, bottom):
            for j in range(left, right):
                out[i, j] += down[i] * across[j]
    return out / max(whole, 1e-9)


@jitted(nogil=True, error_model="numpy")
def line_mask_change(
    path: Array, R: int, sigma: float, begins: NDArray[np.int64], values: Array, points: int
) -> tuple[Array, NDArray[np.int64], Array]:
    """`line_mask`, flat indices (n,) of the pixels that depend on a curve's points, and their derivatives (n, 2 points)
    with respect to x, then y.

    Sampling effects are neglected. begins, values : the first control point of each instant of the path, (T,), and its
    and the following ones' weights, (T, m).
    """
    size = 2 * R + 1
    out, across, down, right, lower = (
        np.zeros((size, size)), np.zeros(size), np.zeros(size), np.zeros(size), np.zeros(size),
    )  # fmt: skip
    changes, row_of = np.empty((size * size, 2 * points)), np.full(size * size, -1)
    pixels, whole, slower = np.empty(size * size, np.int64), 0.0, np.exp(-1 / (SAMPLES * sigma) ** 2)
    count = 0
    for t in range(len(path)):
        left, stop, light = _shares(path[t, 0], R, sigma, slower, across)
        top, bottom, more = _shares(path[t, 1], R, sigma, slower, down)
        first, last = _share_changes(path[t, 0], R, sigma, right)
        upper, lowest = _share_changes(path[t, 1], R, sigma, lower)
        whole += light * more
        for i in range(top, bottom):
            for j in range(left, stop):
                out[i, j] += down[i] * across[j]
            for j in range(first, last):
                at, change = begins[t], down[i] * right[j]
                count = _add_change(changes, row_of, pixels, count, i * size + j, at, change, values, t)
        for i in range(upper, lowest):
            for j in range(left, stop):
                at, change = points + begins[t], lower[i] * across[j]
                count = _add_change(changes, row_of, pixels, count, i * size + j, at, change, values, t)
    changes = changes[:count]
    changes /= len(path)
    return out / max(whole, 1e-9), pixels[:count], changes


@numba.njit(error_model="numpy")
def _add_change(
    changes: Array, row_of: NDArray[np.int64], pixels: NDArray[np.int64], count: int, pixel: int, begin: int,
    change: float, values: Array, t: int,
) -> int:  # fmt: skip
    """Add values[t] times `change` from `begin` on to a pixel's row of `changes`; the number of pixels so far."""
    if row_of[pixel] < 0:
        row_of[pixel], pixels[count] = count, pixel
        changes[count] = 0
        count += 1
    row = row_of[pixel]
    for m in range(CUBIC):
        changes[row, begin + m] += change * values[t, m]
    return count


@numba.njit(error_model="numpy")
def _shares(x: float, R: int, sigma: float, slower: float, out: Array) -> tuple[int, int, float]:
    """Light of an instant at x in each of 2R + 1 pixels, its range and sum: a Gaussian's samples by recurrence; only
    those of `out` are set. slower : ratio of the growth of neighbouring samples, exp(-1 / (SAMPLES sigma)^2)."""
    place, step = (x + R + 0.5) * SAMPLES - 0.5, 1 / (SAMPLES * sigma)
    first, last = int(np.ceil(place - TAIL / step)), int(np.floor(place + TAIL / step))
    away = (first - place) * step
    share = step / np.sqrt(2 * np.pi) * np.exp(-away * away / 2)
    growth = np.exp(-step * (away + step / 2))
    light, k, begin, end = 0.0, first, 2 * R + 1, 0
    while k <= last:
        pixel = k // SAMPLES
        total = 0.0
        for _ in range(min(last + 1, (pixel + 1) * SAMPLES) - k):
            total += share
            share *= growth
            growth *= slower
        k = (pixel + 1) * SAMPLES
        light += total
        if 0 <= pixel <= 2 * R:
            out[pixel] = total
            begin, end = min(begin, pixel), pixel + 1
    return begin, end, light


@numba.njit(error_model="numpy")
def _share_changes(x: float, R: int, sigma: float, out: Array) -> tuple[int, int]:
    """Derivatives of the shares with respect to x, without the effect of sampling; see `_shares`."""
    first = max(int(np.ceil(x - TAIL * sigma + R + 0.5)), 0)
    last = min(int(np.floor(x + TAIL * sigma + R + 0.5)), 2 * R + 1)
    if last < first:  # within a pixel
        return 0, 0
    begin, end = max(first - 1, 0), min(last + 1, 2 * R + 1)
    for k in range(begin, end):
        out[k] = 0.0
    scale = 1 / (np.sqrt(2 * np.pi) * sigma)
    for k in range(first, last + 1):
        away = (k - R - 0.5 - x) / sigma
        density = scale * np.exp(-away * away / 2)
        if k > 0:
            out[k - 1] -= density
        if k <= 2 * R:
            out[k] += density
    return begin, end


# --- a curve as a mask -----------------------------------------------------------------------------------------------


def path_mask(path_px: Array, R: int) -> Array:
    """Mask (2R + 1, 2R + 1), sum 1, of a curve (n, 2), equation (5.2): each instant in four pixels, blurred by the
    aperture. Raises BadInput if it leaves the mask."""
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
    out = gaussian_filter(out, APERTURE_PX, mode="constant")
    return np.asarray(out / out.sum())
