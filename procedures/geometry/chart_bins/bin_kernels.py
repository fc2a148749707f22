"""Inner loops for the bins of a large chart: each is rendered, blurred, and fitted to the photograph.

The products for least squares are summed during rendering, so that the blurred picture is the only one in memory.
"""

from typing import NamedTuple

import numpy as np

from procedures.numerics.arrays import Array, Array32, Indices, Mask
from procedures.numerics.compiled import vectorised

COLUMNS = 5  # parameters of a bin's least squares: brightness, contrast, blur, and the shift along x and y
MARGIN = 6  # pixels rendered around a bin, from which the blur contributes


class RenderModel(NamedTuple):
    """A photograph, the chart's cells, the map between them, and the rendering of bins.

    H (3, 3), centre (2,), radius and displacement (2, 9) are those of `numerics.warps.CubicWarp`, from pixels of the
    picture reduced by `factor` to cells; `origin` is the number of cells from the chart's edge to the noise's corner. A
    bin extends `half` cells to all sides. It is rendered at an odd number `n` of places along every pixel, each of them
    the mean over a square of `side` cells, at most one, and blurred by an odd number of weights `blur`.
    """

    samples: Array32
    chart: Array
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
def chart_at(look: RenderModel, x: float, y: float) -> float:
    """Mean of the chart over a square around a place in cells from the noise's corner; it covers one or two cells."""
    chart, half = look.chart, look.side / 2
    right = min(max(x + look.origin + half, 0.0), chart.shape[1] - 1.0)
    lower = min(max(y + look.origin + half, 0.0), chart.shape[0] - 1.0)
    j, i = int(right), int(lower)
    a, b = min((right - j) / look.side, 1.0), min((lower - i) / look.side, 1.0)
    k, h = max(j - 1, 0), max(i - 1, 0)
    return float((1 - b) * ((1 - a) * chart[h, k] + a * chart[h, j]) + b * ((1 - a) * chart[i, k] + a * chart[i, j]))


@vectorised
def cells_along(look: RenderModel, first: float, y: float, step: float, cells: Array) -> None:
    """Cells (2, count), x and y, at places `step` apart along a row of the photograph, starting at x = first."""
    d, e, H, f, middle = look.displacement[0], look.displacement[1], look.H, look.factor, (look.factor - 1) / 2
    y = (y - middle) / f
    v = (y - look.centre[1]) / look.radius
    # along a row the displacements are cubic in u
    x0, x1, x2 = v * (d[1] + v * (d[4] + v * d[8])), d[0] + v * (d[3] + v * d[7]), d[2] + v * d[6]
    y0, y1, y2 = v * (e[1] + v * (e[4] + v * e[8])), e[0] + v * (e[3] + v * e[7]), e[2] + v * e[6]
    for c in range(cells.shape[1]):
        x = (first + c * step - middle) / f
        u = (x - look.centre[0]) / look.radius
        p = x + x0 + u * (x1 + u * (x2 + u * d[5]))
        q = y + y0 + u * (y1 + u * (y2 + u * e[5]))
        w = 1.0 / (H[2, 0] * p + H[2, 1] * q + H[2, 2])
        cells[0, c] = (H[0, 0] * p + H[0, 1] * q + H[0, 2]) * w
        cells[1, c] = (H[1, 0] * p + H[1, 1] * q + H[1, 2]) * w


@vectorised
def own_pixels(look: RenderModel, centre: Array, offset: Array, low: Indices, own: Mask) -> Indices:
    """Mark the pixels of a bin; gives the first and last place along each fine row required by its derivatives.

    Rows without any have a first greater than the last.
    """
    rows, columns = own.shape
    n, middle = look.n, look.n // 2
    required = np.empty((rows * n, 2), np.int64)
    required[:, 0], required[:, 1] = columns * n, -1
    cells = np.empty((2, columns))
    for r in range(rows):
        cells_along(look, float(low[0]), float(r + low[1]), 1.0, cells)
        for c in range(columns):
            x, y = cells[0, c] - offset[0] - centre[0], cells[1, c] - offset[1] - centre[1]
            own[r, c] = abs(x) < look.half and abs(y) < look.half
            if own[r, c]:
                for i in range(max(r * n + middle - 2, 0), min(r * n + middle + 3, rows * n)):
                    required[i, 0] = min(required[i, 0], max(c * n + middle - 2, 0))
                    required[i, 1] = max(required[i, 1], min(c * n + middle + 2, columns * n - 1))
    return required


@vectorised
def spread(required: Indices, reach: int) -> Indices:
    """Ranges of the rows, each extended to those of the rows within `reach`."""
    extended = required.copy()
    for i in range(len(required)):
        for k in range(max(i - reach, 0), min(i + reach + 1, len(required))):
            extended[i, 0] = min(extended[i, 0], required[k, 0])
            extended[i, 1] = max(extended[i, 1], required[k, 1])
    return extended


@vectorised
def rendered(look: RenderModel, offset: Array, low: Indices, needed: Indices, columns: int) -> Array:
    """The chart at the places of the fine rows that the blur of the needed ones requires; undefined elsewhere."""
    n, reach = look.n, len(look.blur) // 2
    picture, cells = np.empty((len(needed), columns)), np.empty((2, columns))
    for r in range(len(needed)):
        first, last = max(needed[r, 0] - reach, 0), min(needed[r, 1] + reach, columns - 1)
        if needed[r, 0] <= needed[r, 1]:
            along = cells[:, : last - first + 1]
            cells_along(look, (first - n // 2) / n + low[0], (r - n // 2) / n + low[1], 1 / n, along)
            for c in range(last - first + 1):
                picture[r, first + c] = chart_at(look, along[0, c] - offset[0], along[1, c] - offset[1])
    return picture


@vectorised
def blurred(look: RenderModel, picture: Array, needed: Indices, required: Indices) -> Array:
    """A picture blurred along both axes where required, mirrored at its edges: along the needed rows, then columns."""
    rows, columns = picture.shape
    reach = len(look.blur) // 2
    line = np.empty(columns + 2 * reach)
    across, blurred_both = np.zeros((rows, columns)), np.zeros((rows, columns))
    for i in range(rows):
        first, count = needed[i, 0], needed[i, 1] + 1 - needed[i, 0]
        for j in range(count + 2 * reach if count > 0 else 0):
            k = first - reach + j
            k = -k - 1 if k < 0 else 2 * columns - 1 - k if k >= columns else k
            line[j] = picture[i, k]
        total = across[i, first : first + max(count, 0)]
        for t in range(len(look.blur)):
            weight = look.blur[t]
            for j in range(len(total)):
                total[j] += weight * line[j + t]
    for i in range(rows):
        total = blurred_both[i, required[i, 0] : required[i, 1] + 1]
        for t in range(len(look.blur)):
            k = i + t - reach
            k = -k - 1 if k < 0 else 2 * rows - 1 - k if k >= rows else k
            weight, source = look.blur[t], across[k, required[i, 0] : required[i, 1] + 1]
            for j in range(len(source)):
                total[j] += weight * source[j]
    return blurred_both


@vectorised
def fit_bins(look: RenderModel, centres: Array, points: Array, low: Indices, high: Indices, sums: Array) -> None:
    """Products for the least squares of bins with their centres at `points` of the photograph.

    The columns are 1, the rendered chart u, lap u, -u_x, -u_y, and the samples; `sums` (bins, 6, 6) are those of all
    pairs over the pixels of a bin.

    centres, points : (bins, 2) float64, in cells, and in pixels
    low, high : (bins, 2) int64, first and last pixel (x, y) to render at most
    """
    at = np.empty((2, 1))
    for i in range(len(points)):
        cells_along(look, points[i, 0], points[i, 1], 1.0, at)
        offset = at[:, 0] - centres[i]  # the map puts the bin's centre near the point
        columns, rows = high[i, 0] - low[i, 0] + 1, high[i, 1] - low[i, 1] + 1
        own = np.zeros((rows, columns), np.bool_)
        required = own_pixels(look, centres[i], offset, low[i], own)
        needed = spread(required, len(look.blur) // 2)
        picture = rendered(look, offset, low[i], needed, columns * look.n)
        add_products(look, blurred(look, picture, needed, required), own, low[i], sums[i])


@vectorised
def add_products(look: RenderModel, u: Array, own: Mask, low: Indices, sums: Array) -> None:
    """Products of the columns of `fit_bins` over the pixels of a bin, from the chart rendered around it."""
    n, count = look.n, 0
    rows = np.empty((COLUMNS + 1, own.size))
    for r in range(own.shape[0]):
        for c in range(own.shape[1]):
            if own[r, c]:
                i, j = r * n + n // 2, c * n + n // 2
                here = u[i, j]
                rows[0, count], rows[1, count] = 1.0, here
                rows[2, count] = n * n / 4 * (u[i, j + 2] + u[i, j - 2] + u[i + 2, j] + u[i - 2, j] - 4 * here)
                rows[3, count] = n / 2 * (u[i, j - 1] - u[i, j + 1])
                rows[4, count] = n / 2 * (u[i - 1, j] - u[i + 1, j])
                rows[5, count] = look.samples[low[1] + r, low[0] + c]
                count += 1
    for a in range(COLUMNS + 1):
        for b in range(a + 1):
            left, right, total = rows[a, :count], rows[b, :count], 0.0
            for k in range(count):
                total += left[k] * right[k]
            sums[a, b], sums[b, a] = total, total
