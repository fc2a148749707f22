"""Inner loops of space-variant blur: spread pixels over masks, gather errors by masks.

Each uses two neighbouring masks per pixel, which serves the interpolated mask, its adjoint and its derivative, and
processes two pixels at a time, one below the other: a row of the photograph is then loaded and stored once for four
rows of masks. No memory is allocated per pixel, mask rows are whole vectors, and bands of rows are independent.
Masks up to 7 wide have shorter vectors and loops of fixed length: half of the time of the others.
"""

from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from procedures.numerics.compiled import jitted
from procedures.restoration.masks.simd_vectors import (
    FEWER_LANES,
    LANES,
    entry,
    filled,
    load,
    multiply_add,
    store,
    total,
)

Array = NDArray[np.floating[Any]]

REACH = FEWER_LANES // 2 - 1
"""Half-size of the masks with the shorter rows."""


class Pairs(NamedTuple):
    """Every mask next to the following one, cropped to their common support, in the layout of the loops.

    values : flat; pair k begins at start[k] and has width[k] + 2 rows of width[k] entries of mask k, then as many of
    mask k + 1, the masks' centre at row width / 2 + 1, column width / 2. width : that of the shorter vectors, or a
    multiple of that of the longer; first, last : rows relative to the centre outside which both masks are zero.
    """

    values: Array
    start: NDArray[np.int64]
    width: NDArray[np.int64]
    first: NDArray[np.int64]
    last: NDArray[np.int64]


def pairs_of(masks: Array, dtype: type[np.floating[Any]]) -> Pairs:
    """Pairs of masks (L, 2R + 1, 2R + 1)."""
    R = masks.shape[1] // 2
    used = (masks[1:] != 0) | (masks[:-1] != 0)
    (top, bottom), (left, right) = _extent(used.any(axis=2), R), _extent(used.any(axis=1), R)
    reach = np.max([-top, bottom, -left, right], axis=0)
    across = 2 * reach + 1
    width = np.where(across <= FEWER_LANES, FEWER_LANES, -(-across // LANES) * LANES)
    size = 2 * width * (width + 2)
    start = np.cumsum(size) - size
    values = _aligned(int(size.sum()), dtype)
    for k, (at, n, r) in enumerate(zip(start, width, reach, strict=True)):
        block = values[at : at + 2 * n * (n + 2)].reshape(n + 2, 2, n)
        middle, around = slice(n // 2 - r, n // 2 + r + 1), slice(R - r, R + r + 1)
        block[n // 2 + 1 - r : n // 2 + r + 2, :, middle] = masks[k : k + 2, around, around].transpose(1, 0, 2)
    return Pairs(values, start, width, top, bottom)


def _aligned(size: int, dtype: type[np.floating[Any]]) -> Array:
    """Zeros aligned to vectors: a load across two cache lines costs twice."""
    line = 64
    raw = np.zeros(size * np.dtype(dtype).itemsize + line, np.uint8)
    begin = -raw.ctypes.data % line
    return raw[begin : begin + size * np.dtype(dtype).itemsize].view(dtype)


def _extent(used: NDArray[np.bool_], R: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and last used entry along each row (L, 2R + 1), relative to the centre; 0 where there is none."""
    any_used = used.any(axis=1)
    first, last = used.argmax(axis=1) - R, R - used[:, ::-1].argmax(axis=1)
    return np.where(any_used, first, 0), np.where(any_used, last, 0)


@jitted(fastmath=True, nogil=True)
def spread(
    x: Array, u: Array, dw: Array, rate: Any, level: NDArray[np.int32], f: Array, pairs: Pairs, scratch: Array,
    out: Array, top: int, bottom: int,
) -> None:  # fmt: skip
    """The photograph `out` (H, W) of x and of u's change with w: x * h + rate u dw * (mask[level + 1] - mask[level]).

    h = (1 - f) mask[level] + f mask[level + 1]. x, u, dw, level, f : (H + 2R, W + 2R), pixels of negative level are
    skipped; drawn : scratch, flat, (H, W + 2R + the widest pair's width); top, bottom : the rows of `out` to compute.
    """
    values, start, width, firsts, lasts = pairs
    rows, columns = level.shape
    R = (rows - out.shape[0]) // 2
    stride = scratch.size // out.shape[0]
    margin = (stride - columns) // 2
    zero = x.dtype.type(0)
    xs, us, dws, fs, levels = x.ravel(), u.ravel(), dw.ravel(), f.ravel(), level.ravel()
    scratch[top * stride : bottom * stride] = 0
    for i in range(top, bottom + 2 * R, 2):
        below = min(i + 1, rows - 1)
        # small masks are drawn whole, without regard to their empty rows
        above, whole = (i - R - REACH) * stride + margin - REACH - 1, top <= i - R - REACH <= bottom - FEWER_LANES
        for j in range(columns):
            one_at, two_at = i * columns + j, below * columns + j
            k = int(entry(levels, one_at))
            m = int(entry(levels, two_at)) if i < below else -1
            p, q, s, t = zero, zero, zero, zero
            if k >= 0:
                p, q = _shares(xs, fs, us, dws, rate, one_at)
            if m >= 0:
                s, t = _shares(xs, fs, us, dws, rate, two_at)
            if whole and _both_small(width, k, m):
                at, one, two = above + j, entry(start, k) + 4 * FEWER_LANES, entry(start, m) + 2 * FEWER_LANES
                _draw(scratch, at, stride, FEWER_LANES, values, one, two, FEWER_LANES, FEWER_LANES, p, q, s, t)
                continue
            k, m = k if k >= 0 else m, m if m >= 0 else k
            if k < 0:
                continue
            # pairs of different widths have different layouts: each is drawn with itself and weight zero
            different = entry(width, k) != entry(width, m)
            one, two, p0, q0, p1, q1 = (k, k, p, q, zero, zero) if different else (k, m, p, q, s, t)
            while True:
                w = entry(width, one)
                first = max(top - i + R, min(entry(firsts, one), 1 + entry(firsts, two)))
                last = min(bottom - 1 - i + R, max(entry(lasts, one), 1 + entry(lasts, two)))
                row = first + w // 2
                at = (i - R + first) * stride + margin + j - w // 2
                upper, lower = entry(start, one) + 2 * w * (row + 1), entry(start, two) + 2 * w * row
                if w == FEWER_LANES:
                    _draw(scratch, at, stride, last - first + 1, values, upper, lower, w, FEWER_LANES, p0, q0, p1, q1)
                else:
                    _draw(scratch, at, stride, last - first + 1, values, upper, lower, w, LANES, p0, q0, p1, q1)
                if not different:
                    break
                one, two, p0, q0, p1, q1, different = m, m, zero, zero, s, t, False
    for i in range(top, bottom):
        for j in range(out.shape[1]):
            out[i, j] = scratch[i * stride + margin + R + j]


@numba.njit(inline="always")
def _both_small(width: NDArray[np.int64], k: int, m: int) -> bool:
    """Whether both pixels count, and their pairs of masks have the shorter rows."""
    return (k >= 0) & (m >= 0) and (entry(width, k) == FEWER_LANES) & (entry(width, m) == FEWER_LANES)


@numba.njit(inline="always")
def _shares(x: Array, f: Array, u: Array, dw: Array, rate: Any, at: int) -> tuple[Any, Any]:
    """Weights of a pixel for its lower and its upper mask."""
    upper = entry(x, at) * entry(f, at) + rate * entry(u, at) * entry(dw, at)
    return entry(x, at) - upper, upper


@numba.njit(inline="always")
def _draw(
    out: Array, at: int, stride: int, rows: int, values: Array, above: int, below: int, width: int,
    lanes: int, p: Any, q: Any, s: Any, t: Any,
) -> None:  # fmt: skip
    """Add p, q times the pair of masks from `above` on and s, t times that from `below` on to `rows` rows of `out`."""
    lp, lq, ls, lt = filled(p, lanes), filled(q, lanes), filled(s, lanes), filled(t, lanes)
    for column in range(0, width, lanes):
        here, one, two = at + column, above + column, below + column
        for _ in range(rows):
            row = load(out, here, lanes)
            row = multiply_add(lp, load(values, one, lanes), row)
            row = multiply_add(lq, load(values, one + width, lanes), row)
            row = multiply_add(ls, load(values, two, lanes), row)
            row = multiply_add(lt, load(values, two + width, lanes), row)
            store(row, out, here)
            here += stride
            one += 2 * width
            two += 2 * width


@jitted(fastmath=True, nogil=True)
def gather(
    e: Array, level: NDArray[np.int32], f: Array, pairs: Pairs, u: Array, rate: Any, dx: Array, dw: Array,
    top: int, bottom: int,
) -> None:  # fmt: skip
    """Add the adjoint of `spread` to dx and dw: products of the errors around each pixel with its masks.

    e : (H + 4R + 1, W + 2R + the widest pair's width), zero outside the photograph, which begins 2R rows down and R
    columns and half that width across; the others : (H + 2R, W + 2R), of which rows top to bottom are visited.
    """
    values, start, width, firsts, lasts = pairs
    rows, columns = level.shape
    stride = e.shape[1]
    margin = (stride - columns) // 2
    R = (e.shape[0] - 1 - rows) // 2
    errors, levels = e.ravel(), level.ravel()
    for i in range(top, bottom, 2):
        below = min(i + 1, bottom - 1)
        above = (i + R - REACH) * stride + margin - REACH - 1
        for j in range(columns):
            k = int(entry(levels, i * columns + j))
            m = int(entry(levels, below * columns + j)) if i < below else -1
            if _both_small(width, k, m):
                at, one, two = above + j, entry(start, k) + 4 * FEWER_LANES, entry(start, m) + 2 * FEWER_LANES
                p, q, s, t = _correlate(errors, at, stride, FEWER_LANES, values, one, two, FEWER_LANES, FEWER_LANES)
                dx[i, j] += p + f[i, j] * (q - p)
                dw[i, j] += rate * u[i, j] * (q - p)
                dx[below, j] += s + f[below, j] * (t - s)
                dw[below, j] += rate * u[below, j] * (t - s)
                continue
            one, two = k if k >= 0 else m, m if m >= 0 else k
            if one < 0:
                continue
            different = entry(width, one) != entry(width, two)
            if different:
                two = one
            while True:
                w = entry(width, one)
                first = min(entry(firsts, one), 1 + entry(firsts, two))
                last = max(entry(lasts, one), 1 + entry(lasts, two))
                row = first + w // 2
                at = (i + R + first) * stride + margin + j - w // 2
                upper, lower = entry(start, one) + 2 * w * (row + 1), entry(start, two) + 2 * w * row
                if w == FEWER_LANES:
                    p, q, s, t = _correlate(errors, at, stride, last - first + 1, values, upper, lower, w, FEWER_LANES)
                else:
                    p, q, s, t = _correlate(errors, at, stride, last - first + 1, values, upper, lower, w, LANES)
                if one == k:
                    dx[i, j] += p + f[i, j] * (q - p)
                    dw[i, j] += rate * u[i, j] * (q - p)
                if two == m:
                    dx[below, j] += s + f[below, j] * (t - s)
                    dw[below, j] += rate * u[below, j] * (t - s)
                if not different:
                    break
                one, two, different = m, m, False


@numba.njit(inline="always")
def _correlate(
    e: Array, at: int, stride: int, rows: int, values: Array, above: int, below: int, width: int, lanes: int
) -> Any:  # fmt: skip
    """Products of `rows` rows of a flat `e`, from `at` on, with two pairs of masks, from `above` and `below` on."""
    lp = filled(e.dtype.type(0), lanes)
    lq, ls, lt = lp, lp, lp
    for column in range(0, width, lanes):
        here, one, two = at + column, above + column, below + column
        for _ in range(rows):
            row = load(e, here, lanes)
            lp = multiply_add(row, load(values, one, lanes), lp)
            lq = multiply_add(row, load(values, one + width, lanes), lq)
            ls = multiply_add(row, load(values, two, lanes), ls)
            lt = multiply_add(row, load(values, two + width, lanes), lt)
            here += stride
            one += 2 * width
            two += 2 * width
    return total(lp), total(lq), total(ls), total(lt)
