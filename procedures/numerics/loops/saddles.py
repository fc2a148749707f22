"""Inner loops of the saddle detector: saddle points of a Gaussian scale space, and their similarity to x-corners."""

import numpy as np
import numpy.typing as npt

from procedures.numerics.arrays import Array, Indices
from procedures.numerics.compiled import compiled, vectorised

Picture = npt.NDArray[np.float32]


@vectorised
def _down(image: Picture, y: int, g: Picture, d: Picture, dd: Picture, v: Picture) -> None:
    """Filter row y vertically by the three kernels into v (3, 4 + columns + 4), mirrored at the border."""
    last, n = image.shape[0] - 1, image.shape[1]
    middle = image[y]
    a1, b1 = image[abs(y - 1)], image[last - abs(last - y - 1)]
    a2, b2 = image[abs(y - 2)], image[last - abs(last - y - 2)]
    a3, b3 = image[abs(y - 3)], image[last - abs(last - y - 3)]
    a4, b4 = image[abs(y - 4)], image[last - abs(last - y - 4)]
    vg, vd, vdd = v[0], v[1], v[2]
    for j in range(n):
        s1, s2, s3, s4 = a1[j] + b1[j], a2[j] + b2[j], a3[j] + b3[j], a4[j] + b4[j]
        vg[j + 4] = g[0] * middle[j] + g[1] * s1 + g[2] * s2 + g[3] * s3 + g[4] * s4
        vdd[j + 4] = dd[0] * middle[j] + dd[1] * s1 + dd[2] * s2 + dd[3] * s3 + dd[4] * s4
        vd[j + 4] = d[1] * (b1[j] - a1[j]) + d[2] * (b2[j] - a2[j]) + d[3] * (b3[j] - a3[j]) + d[4] * (b4[j] - a4[j])
    for m in range(3):
        for t in range(1, 5):
            v[m, 4 - t], v[m, n + 3 + t] = v[m, 4 + t], v[m, n + 3 - t]


@vectorised
def _across(
    v: Picture, g: Picture, d: Picture, dd: Picture, flatter: float, weakest: float,
    determinant: Picture, half: Picture, xy: Picture, fit: npt.NDArray[np.bool_],
) -> None:  # fmt: skip
    """Filter the result of `_down` horizontally: squared strength minus squared mean curvature, (Lxx - Lyy) / 2, Lxy,
    and the mask of sufficient strength and isotropy."""
    a, b, c = v[0], v[1], v[2]
    flat, least = np.float32(flatter * flatter), np.float32(weakest * weakest)
    for j in range(len(half)):
        i = j + 4
        xx = (
            dd[0] * a[i] + dd[1] * (a[i - 1] + a[i + 1]) + dd[2] * (a[i - 2] + a[i + 2])
            + dd[3] * (a[i - 3] + a[i + 3]) + dd[4] * (a[i - 4] + a[i + 4])
        )  # fmt: skip
        yy = (
            g[0] * c[i] + g[1] * (c[i - 1] + c[i + 1]) + g[2] * (c[i - 2] + c[i + 2])
            + g[3] * (c[i - 3] + c[i + 3]) + g[4] * (c[i - 4] + c[i + 4])
        )  # fmt: skip
        cross = (
            d[1] * (b[i + 1] - b[i - 1]) + d[2] * (b[i + 2] - b[i - 2])
            + d[3] * (b[i + 3] - b[i - 3]) + d[4] * (b[i + 4] - b[i - 4])
        )  # fmt: skip
        mean, difference = np.float32(0.5) * (xx + yy), np.float32(0.5) * (xx - yy)
        squared = difference * difference + cross * cross
        mean *= mean
        half[j], xy[j], determinant[j] = difference, cross, squared - mean
        fit[j] = (mean < flat * squared) & (squared > least)


@vectorised
def _peaks(above: Picture, here: Picture, below: Picture, fit: npt.NDArray[np.bool_]) -> None:
    """Restrict the mask to local maxima among eight neighbours; rows (1 + columns + 1)."""
    for j in range(len(fit)):
        p = here[j + 1]
        rows = (p >= above[j]) & (p >= above[j + 1]) & (p >= above[j + 2])
        rows &= (p >= below[j]) & (p >= below[j + 1]) & (p >= below[j + 2])
        fit[j] &= rows & (p >= here[j]) & (p >= here[j + 2])


@compiled
def _clear(row: Picture) -> None:
    for j in range(len(row)):
        row[j] = -np.inf


@compiled
def saddle_points(image: Picture, kernels: Picture, flatter: float, weakest: float) -> tuple[Indices, Picture, Picture]:
    """Local extrema of saddle strength, row by row: flat indices, (Lxx - Lyy) / 2 and Lxy there.

    image : (rows >= 5, columns >= 5) float32
    kernels : (3, 5) float32 Gaussian and its first two derivatives, from the middle on
    flatter : greatest mean curvature over strength
    weakest : least strength
    """
    rows, n = image.shape
    g, d, dd = kernels[0], kernels[1], kernels[2]
    v = np.empty((3, n + 8), np.float32)
    determinant = np.empty((3, n + 2), np.float32)
    for m in range(3):
        _clear(determinant[m])
    half, xy, fit = np.empty((2, n), np.float32), np.empty((2, n), np.float32), np.empty((2, n), np.bool_)
    # unwritten memory is not allocated; adjacent extrema are equal to the last bit, so a quarter suffices
    most = image.size // 4
    index, halves, crosses = np.empty(most, np.int64), np.empty(most, np.float32), np.empty(most, np.float32)
    count = 0
    for y in range(rows + 1):
        new, old = y % 2, 1 - y % 2
        if y < rows:
            _down(image, y, g, d, dd, v)
            _across(v, g, d, dd, flatter, weakest, determinant[y % 3, 1:-1], half[new], xy[new], fit[new])
        else:
            _clear(determinant[y % 3])
        if y == 0:
            continue
        _peaks(determinant[(y - 2) % 3], determinant[(y - 1) % 3], determinant[y % 3], fit[old])
        for j in range(n):
            if fit[old, j] and count < most:
                index[count], halves[count], crosses[count] = (y - 1) * n + j, half[old, j], xy[old, j]
                count += 1
    return index[:count], halves[:count], crosses[:count]


@compiled
def ring_purity(image: Picture, index: Indices, radius: float, off_centre: float) -> Picture:
    """Share of the second harmonic in the remaining variance on a ring of eight samples around pixels (n,).

    index : (n,) int64 pixels of the picture, flattened
    radius : radius of the ring, in pixels
    off_centre : share of the first harmonic that is subtracted from the variance
    """
    rows, columns = image.shape
    left, upper = np.empty(8, np.int64), np.empty(8, np.int64)
    fx, fy = np.empty(8, np.float32), np.empty(8, np.float32)
    for t in range(8):
        dx, dy = radius * np.cos(t * np.pi / 4), radius * np.sin(t * np.pi / 4)
        left[t], upper[t] = np.int64(np.floor(dx)), np.int64(np.floor(dy))
        fx[t], fy[t] = dx - left[t], dy - upper[t]
    r = np.float32(np.sqrt(0.5))
    purity = np.empty(len(index), np.float32)
    v = np.empty(8, np.float32)
    for n in range(len(index)):
        row, column = index[n] // columns, index[n] % columns
        for t in range(8):
            i, j = row + upper[t], column + left[t]
            i0, i1 = min(max(i, 0), rows - 1), min(max(i + 1, 0), rows - 1)
            j0, j1 = min(max(j, 0), columns - 1), min(max(j + 1, 0), columns - 1)
            a = image[i0, j0] + fx[t] * (image[i0, j1] - image[i0, j0])
            b = image[i1, j0] + fx[t] * (image[i1, j1] - image[i1, j0])
            v[t] = a + fy[t] * (b - a)
        mean, square = np.float32(0), np.float32(0)
        for t in range(8):
            mean += v[t] / np.float32(8)
        for t in range(8):
            square += (v[t] - mean) ** 2
        # harmonics of eight samples by their symmetries
        p, q, u, w = v[0] - v[4], v[1] - v[5], v[2] - v[6], v[3] - v[7]
        first = (p + r * (q - w)) ** 2 + (u + r * (q + w)) ** 2
        second = (v[0] + v[4] - v[2] - v[6]) ** 2 + (v[1] + v[5] - v[3] - v[7]) ** 2
        rest = square - np.float32(off_centre / 4) * first
        purity[n] = second / np.float32(4) / max(rest, np.float32(1e-30))
    return purity


@compiled
def best_of_tiles(index: Indices, shape: tuple[int, int], merits: Array, side: int, most: int) -> Indices:
    """Indices of the best pixels (n,), equally many from every tile, `most` in total or just more."""
    across = (shape[1] - 1) // side + 1
    starts = np.zeros(((shape[0] - 1) // side + 1) * across + 1, np.int64)
    tiles, crowds = np.empty(len(index), np.int64), np.zeros(side * side + 1, np.int64)
    for n in range(len(index)):
        tiles[n] = index[n] // shape[1] // side * across + index[n] % shape[1] // side
        starts[tiles[n] + 1] += 1
    for tile in range(len(starts) - 1):
        crowds[starts[tile + 1]] += 1
    each, kept, more = 0, 0, len(starts) - 1
    while kept < min(most, len(index)):
        more -= crowds[each]  # number of tiles with another pixel
        kept += more
        each += 1
    for tile in range(len(starts) - 1):
        starts[tile + 1] = starts[tile] + min(starts[tile + 1], each)
    # best pixels of a tile so far, in ascending order
    best, held = np.empty(starts[-1], np.int64), np.zeros(len(starts) - 1, np.int64)
    for n in range(len(index)):
        first, room = starts[tiles[n]], starts[tiles[n] + 1] - starts[tiles[n]]
        m = held[tiles[n]]
        if m < room:
            held[tiles[n]] += 1
            while m > 0 and merits[best[first + m - 1]] > merits[n]:
                best[first + m] = best[first + m - 1]
                m -= 1
            best[first + m] = n
        elif merits[n] > merits[best[first]]:
            m = 0
            while m + 1 < room and merits[best[first + m + 1]] < merits[n]:
                best[first + m] = best[first + m + 1]
                m += 1
            best[first + m] = n
    return best
