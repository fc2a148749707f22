"""The inner loops of a large chart's bins: each drawn as it should be seen, blurred, and held against the photograph.

What least squares of a bin needs is summed while it is drawn: pictures of it are never made whole but for the one that
is blurred.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from procedures.numerics.compiled import vectorised

Array = npt.NDArray[np.float64]
Array32 = npt.NDArray[np.float32]
Indices = npt.NDArray[np.int64]

COLUMNS = 5
"""Of a bin's least squares: brightness, contrast, blur, and the shift along x and y."""
MARGIN = 6
"""Pixels drawn around a bin: what blurs into it."""


class Look(NamedTuple):
    """A photograph, the chart's integral, the map between them, and how a bin is drawn.

    H (3, 3), centre (2,), radius and displacement (2, 9) are those of `numerics.warps.CubicWarp`, from the pixels of a
    picture of means over `factor` x `factor` to cells; `origin` is where the integral begins, in cells before the
    noise's corner. A bin reaches `half` cells to all sides; it is drawn at `n` places along every pixel, n odd, each
    the mean over a square of `side` cells, and blurred by the weights `blur`, an odd number.
    """

    samples: Array32
    integral: Array
    H: Array
    centre: Array
    radius: float
    displacement: Array
    factor: int
    origin: float
    half: float
    n: int
    side: float
    blur: Array


@vectorised
def cell_at(look: Look, x: float, y: float) -> tuple[float, float]:
    """The cell (x, y) seen at a pixel of the photograph."""
    x, y = (x - (look.factor - 1) / 2) / look.factor, (y - (look.factor - 1) / 2) / look.factor
    u, v = (x - look.centre[0]) / look.radius, (y - look.centre[1]) / look.radius
    d = look.displacement
    uu, uv, vv = u * u, u * v, v * v
    x += d[0, 0] * u + d[0, 1] * v + d[0, 2] * uu + d[0, 3] * uv + d[0, 4] * vv
    x += uu * (d[0, 5] * u + d[0, 6] * v) + vv * (d[0, 7] * u + d[0, 8] * v)
    y += d[1, 0] * u + d[1, 1] * v + d[1, 2] * uu + d[1, 3] * uv + d[1, 4] * vv
    y += uu * (d[1, 5] * u + d[1, 6] * v) + vv * (d[1, 7] * u + d[1, 8] * v)
    H = look.H
    w = H[2, 0] * x + H[2, 1] * y + H[2, 2]
    return (H[0, 0] * x + H[0, 1] * y + H[0, 2]) / w, (H[1, 0] * x + H[1, 1] * y + H[1, 2]) / w


@vectorised
def integral_at(table: Array, x: float, y: float) -> float:
    """The integral at (x, y): exact between its lines, as cells are even."""
    x, y = min(max(x, 0.0), table.shape[1] - 1.001), min(max(y, 0.0), table.shape[0] - 1.001)
    j, i = int(x), int(y)
    a, b = x - j, y - i
    above = (1 - a) * table[i, j] + a * table[i, j + 1]
    return float((1 - b) * above + b * ((1 - a) * table[i + 1, j] + a * table[i + 1, j + 1]))


@vectorised
def chart_at(look: Look, x: float, y: float) -> float:
    """The chart's mean over a square around a place, in cells from the noise's corner."""
    x, y, half = x + look.origin, y + look.origin, look.side / 2
    whole = integral_at(look.integral, x + half, y + half) + integral_at(look.integral, x - half, y - half)
    beside = integral_at(look.integral, x - half, y + half) + integral_at(look.integral, x + half, y - half)
    return float((whole - beside) / look.side**2)


@vectorised
def blurred(look: Look, picture: Array) -> Array:
    """A picture blurred along both axes, mirrored at its rim."""
    rows, columns = picture.shape
    reach = len(look.blur) // 2
    line = np.empty(columns + 2 * reach)
    across = np.zeros((rows, columns))
    for i in range(rows):
        for j in range(columns):
            line[reach + j] = picture[i, j]
        for j in range(reach):
            line[reach - 1 - j] = picture[i, j]
            line[reach + columns + j] = picture[i, columns - 1 - j]
        total = across[i]
        for t in range(len(look.blur)):
            weight = look.blur[t]
            for j in range(columns):
                total[j] += weight * line[j + t]
    found = np.zeros((rows, columns))
    for i in range(rows):
        total = found[i]
        for t in range(len(look.blur)):
            k = i + t - reach
            k = -k - 1 if k < 0 else 2 * rows - 1 - k if k >= rows else k
            weight, source = look.blur[t], across[k]
            for j in range(columns):
                total[j] += weight * source[j]
    return found


@vectorised
def lay_bins(look: Look, centres: Array, points: Array, low: Indices, high: Indices, sums: Array) -> None:
    """Least squares of bins whose centres lie at `points` of the photograph, as products of their columns.

    The columns are 1, the drawn chart u, lap u, -u_x, -u_y, and last the samples: `sums` (bins, 6, 6) are of all pairs
    over a bin's own pixels.

    Parameters
    ----------
    centres, points : (bins, 2) float64
        In cells, and in pixels.
    low, high : (bins, 2) int64
        First and last pixel (x, y) that is drawn.
    """
    n, middle = look.n, look.n // 2
    for i in range(len(points)):
        at = cell_at(look, points[i, 0], points[i, 1])
        # the map has the bin's centre a little beside the point
        beside_x, beside_y = at[0] - centres[i, 0], at[1] - centres[i, 1]
        columns, rows = high[i, 0] - low[i, 0] + 1, high[i, 1] - low[i, 1] + 1
        picture, own = np.empty((rows * n, columns * n)), np.zeros((rows, columns), np.bool_)
        for r in range(rows * n):
            y = (r - middle) / n + low[i, 1]
            for c in range(columns * n):
                cell = cell_at(look, (c - middle) / n + low[i, 0], y)
                u, v = cell[0] - beside_x, cell[1] - beside_y
                picture[r, c] = chart_at(look, u, v)
                if r % n == middle and c % n == middle:
                    near = abs(u - centres[i, 0]) < look.half and abs(v - centres[i, 1]) < look.half
                    own[r // n, c // n] = near
        add_products(look, blurred(look, picture), own, low[i], sums[i])


@vectorised
def add_products(look: Look, u: Array, own: npt.NDArray[np.bool_], low: Indices, sums: Array) -> None:
    """The products of the columns of `lay_bins` over a bin's own pixels, from the chart drawn around it."""
    n = look.n
    row = np.empty(COLUMNS + 1)
    for a in range(COLUMNS + 1):
        for b in range(COLUMNS + 1):
            sums[a, b] = 0.0
    for r in range(own.shape[0]):
        for c in range(own.shape[1]):
            if own[r, c]:
                i, j = r * n + n // 2, c * n + n // 2
                here = u[i, j]
                row[0], row[1] = 1.0, here
                row[2] = n * n / 4 * (u[i, j + 2] + u[i, j - 2] + u[i + 2, j] + u[i - 2, j] - 4 * here)
                row[3], row[4] = n / 2 * (u[i, j - 1] - u[i, j + 1]), n / 2 * (u[i - 1, j] - u[i + 1, j])
                row[5] = look.samples[low[1] + r, low[0] + c]
                for a in range(COLUMNS + 1):
                    for b in range(a + 1):
                        sums[a, b] += row[a] * row[b]
    for a in range(COLUMNS + 1):
        for b in range(a):
            sums[b, a] = sums[a, b]
