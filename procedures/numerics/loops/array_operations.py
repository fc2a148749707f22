"""The loops by array operations of NumPy and SciPy, where the extension is not installed."""

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.linalg import cho_solve, solve_triangular
from scipy.sparse import csr_array, hstack
from scipy.spatial import KDTree

from procedures.numerics.arrays import Array, Array32, BinnedSaddles, Complex, Indices, LayoutRules, Mask

Complex64 = npt.NDArray[np.complex64]
Indices32 = npt.NDArray[np.int32]
FAR = 1e9  # greatest coordinate, as homographies can map points arbitrarily far


# --- Sparse derivative of the samples by the offsets of printed edges: a few lines of each direction per sample ---


def _sparse(*columns: npt.NDArray[Any], lines: int) -> csr_array:
    """C (m, 2 lines) of `printed_edges.EdgeColumns`."""
    parts = []
    for values, first in zip(columns[::2], columns[1::2], strict=True):
        line = first[:, None] + np.arange(values.shape[1])
        inside = line < lines
        parts.append(csr_array((values[inside], (np.nonzero(inside)[0], line[inside])), shape=(len(values), lines)))
    return hstack(parts, format="csr")


def apply_edges(
    vertical: Array32, first_vertical: Indices32, horizontal: Array32, first_horizontal: Indices32, offsets: Array32
) -> Array32:
    """C offsets, (m,)."""
    C = _sparse(vertical, first_vertical, horizontal, first_horizontal, lines=len(offsets) // 2)
    return np.asarray(C @ offsets)


def apply_edges_transposed(
    vertical: Array32, first_vertical: Indices32, horizontal: Array32, first_horizontal: Indices32, samples: Array32,
    lines: int,
) -> Array32:  # fmt: skip
    """C' samples, (2 lines,)."""
    C = _sparse(vertical, first_vertical, horizontal, first_horizontal, lines=lines)
    return np.asarray(C.T @ samples)


def edge_gram(
    vertical: Array32, first_vertical: Indices32, horizontal: Array32, first_horizontal: Indices32, lines: int
) -> Array32:
    """Lower half of C'C, (2 lines, 2 lines)."""
    C = _sparse(vertical, first_vertical, horizontal, first_horizontal, lines=lines)
    return np.tril((C.T @ C).toarray())


def edge_lines(
    cells: Array, steps: Array32, fine: Array32, scale: Array, reach: Array, pieces: int, weight: Array32
) -> tuple[Array32, Indices32]:
    """Values (m, width) of the vertical lines around each sample, and the first line of each (m,); `steps` (257, 256)
    is the chart's step over each line, `scale` takes cells to samples of `fine`."""
    n, size, width = steps.shape[1], len(fine), 2 * int(np.ceil(reach[0])) + 1
    u, v = cells.T[..., None]
    first = np.clip(np.floor(u - reach[0]), 0, n).astype(np.int32)
    low = np.maximum((v - reach[1]).astype(int), 0)
    high = np.minimum((v + reach[1]).astype(int) + 1, n)
    points = np.arange(int((high - low).max(initial=0)) * pieces)
    row, down = low + points // pieces, v - low - (points + 0.5) / pieces
    values = np.zeros((len(cells), width), np.float32)
    for a in range(width):
        line = first + a
        x, y = (np.floor(s[0] * (u - line) + s[1] * down + size // 2 + 0.5).astype(int) for s in scale)
        inside = (row < high) & (line <= n) & (np.minimum(x, y) >= 0) & (np.maximum(x, y) < size)
        at, point = np.nonzero(inside)
        products = steps[line[at, 0], row[at, point]] * fine[y[inside], x[inside]]
        values[:, a] = np.bincount(at, products, len(cells)) * weight / pieces
    return values, first[:, 0]


# --- Saddles in square bins: the neighbours of a place, and triples and sides in the layout of a chart's x-corners ---


def _tree(field: BinnedSaddles) -> KDTree:
    return KDTree(np.column_stack([field.points.real, field.points.imag]))


def _alike(field: BinnedSaddles, i: Indices, j: Indices, rules: LayoutRules) -> Mask:
    """Whether saddles (n,) have nearly the same axis, and merits within a ratio."""
    a, b = field.merits[i], field.merits[j]
    cosine = (field.axes[i] * field.axes[j].conj()).real
    return np.asarray((cosine > rules.same_axis) & (a < rules.same_merit * b) & (b < rules.same_merit * a))


def _nearest(field: BinnedSaddles, places: Complex, reaches: Array, likes: Indices, rules: LayoutRules) -> Indices:
    """Nearest saddles within reaches of places (n,) that are similar to given ones; -1 for none."""
    nearest = np.full(len(places), -1)
    near = np.flatnonzero(np.abs(places) < FAR)
    points = np.column_stack([places[near].real, places[near].imag])
    around = _tree(field).query_ball_point(points, reaches[near]) if len(near) else []
    place = np.repeat(near, [len(one) for one in around])
    index = np.concatenate([np.zeros(0, np.int64), *around]).astype(np.int64)
    similar = _alike(field, index, likes[place], rules)
    place, index = place[similar], index[similar]
    order = np.lexsort((np.abs(field.points[index] - places[place]), place))
    known, first = np.unique(place[order], return_index=True)
    nearest[known] = index[order][first]
    return nearest


def all_nearest(field: BinnedSaddles, places: Complex, reaches: Array, likes: Indices, rules: LayoutRules) -> Indices:
    """Nearest saddles within reaches (n,) of places (n, m), similar to the saddles of indices (n,); -1 for none."""
    each = places.shape[1]
    nearest = _nearest(field, places.ravel(), np.repeat(reaches, each), np.repeat(likes, each), rules)
    return nearest.reshape(places.shape)


def non_maximum_suppression(field: BinnedSaddles, radius: float, same_axis: float) -> Mask:
    """Mask of the saddles with no better one of similar axis within a radius; the last of equal ones."""
    i, j = _tree(field).query_pairs(radius, output_type="ndarray").T
    worse = np.where(field.merits[i] > field.merits[j], j, i)
    alone = np.ones(len(field.points), np.bool_)
    alone[worse[(field.axes[i] * field.axes[j].conj()).real > same_axis]] = False
    return alone


def _are_steps(field: BinnedSaddles, i: Indices, j: Indices, rules: LayoutRules) -> Mask:
    """Whether two similar saddles lie one lattice step apart, parallel or perpendicular to their axis."""
    d, axis = field.points[j] - field.points[i], field.axes[i] + field.axes[j]
    length = np.abs(d)
    straight = np.abs((d * d * axis.conj()).real) > rules.along_axis * length**2 * np.abs(axis)
    near = (length > rules.min_step) & (length < rules.max_step)
    return np.asarray(near & straight & _alike(field, i, j, rules))


def _are_free(field: BinnedSaddles, i: Indices, j: Indices, rules: LayoutRules) -> Mask:
    """Whether no similar saddle lies midway between two."""
    a, b = field.points[i], field.points[j]
    return np.asarray(_nearest(field, (a + b) / 2, rules.middle_radius * np.abs(a - b), i, rules) < 0)


def collinear_triples(field: BinnedSaddles, rules: LayoutRules) -> Indices:
    """Triples (n, 3) of similar saddles, equally spaced on a line, in one or both directions."""
    pairs = _tree(field).query_pairs(rules.max_step, output_type="ndarray")
    pairs = np.concatenate([pairs, pairs[:, ::-1]])
    i, j = pairs.T
    step = field.points[j] - field.points[i]
    pairs = pairs[(step.imag >= -rules.level_slope * np.abs(step.real)) & _are_steps(field, i, j, rules)]
    i, j = pairs[np.lexsort(pairs.T[::-1])].T
    step = field.points[j] - field.points[i]
    k = _nearest(field, field.points[j] + step, rules.collinear * np.abs(step), j, rules)
    triples = np.stack([i, j, k], axis=1)[(k >= 0) & _are_steps(field, j, k, rules)]
    i, j, k = triples.T
    return np.asarray(triples[_are_free(field, i, j, rules) | _are_free(field, j, k, rules)])


def square_sides(field: BinnedSaddles, triples: Indices, rules: LayoutRules) -> Indices:
    """Hypotheses that triples start at s = 0 or 1 of the side t = 0, with the chart on one side of it or the other.

    Returns the hits (n, 12) in the order of RIM, -1 for none, of the hypotheses with enough of the five nearest other
    x-corners, one of them off the side, and without both inner neighbours, which only a lattice of saddles has.
    """
    i, j, k = triples.T
    free = _are_free(field, i, j, rules) & _are_free(field, j, k, rules)
    least = np.repeat(np.where(free, rules.min_near, rules.min_near_crowded), 4)
    first, triples = np.tile([0, 1, 0, 1], len(triples)), np.repeat(triples, 4, axis=0)
    u = (field.points[triples[:, 2]] - field.points[triples[:, 0]]) / 2
    v, origin = u * np.tile([1j, 1j, -1j, -1j], len(triples) // 4), field.points[triples[:, 0]] - first * u

    def at(s: int | Indices, t: int, share: float) -> Indices:
        return _nearest(field, origin + s * u + t * v, share * np.abs(u), triples[:, 1], rules)

    hits = np.full((len(triples), 12), -1)
    for place, (s, t) in enumerate(((0, 1), (3, 1), (0, 2), (3, 2)), 4):
        hits[:, place] = at(s, t, rules.square)
    good = (hits >= 0).any(axis=1) & ~((at(1, 1, rules.collinear) >= 0) & (at(2, 1, rules.collinear) >= 0))
    row, end = np.arange(len(triples)), 3 - 3 * first
    hits[row, end] = at(end, 0, rules.square)
    good &= (hits >= 0).sum(axis=1) >= least
    hits[row[:, None], first[:, None] + np.arange(3)] = triples
    return hits[good]


# --- Matrices of sampled convolutions, and triangular systems ---


def _windows(raster: Array32, rows: Indices, columns: Indices, s: int, k: int) -> Array32:
    """The k x k samples of a raster at each pixel, (m, k, k)."""
    return np.asarray(np.lib.stride_tricks.sliding_window_view(raster, (k, k))[s * rows, s * columns])


def fill_convolution(
    A: Array32, raster: Array32, rows: Indices, columns: Indices, weight: Array32, s: int, k: int
) -> None:
    """The first k^2 columns of `sample_convolution`."""
    reversed_windows = _windows(raster, rows, columns, s, k)[:, ::-1, ::-1]
    A[:, : k * k] = weight[:, None] * reversed_windows.reshape(len(rows), k * k)


def convolve_at(raster: Array32, rows: Indices, columns: Indices, h: Array32, s: int) -> Array32:
    """A raster convolved with h (k, k), at pixels only: (m,) float32. Arguments as in `sample_convolution`."""
    return _windows(raster, rows, columns, s, len(h)).reshape(len(rows), -1) @ h[::-1, ::-1].ravel()


def sums_of_groups(A: Array32, group: Indices, factor: Array32, count: int) -> Array32:
    """Sums over groups of a matrix' rows (m, n), each times its factor (m,): (count, n)."""
    return np.asarray(csr_array((factor, (group, np.arange(len(A)))), shape=(count, len(A))) @ A)


def substituted(L: npt.NDArray[np.floating], b: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
    """`solve_factored` for one column; both in one precision."""
    return np.asarray(cho_solve((L, True), b))


def inverted(L: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
    """Inverse of a lower triangular matrix."""
    return np.asarray(solve_triangular(L, np.eye(len(L), dtype=L.dtype), lower=True))


# --- Saddle points of a Gaussian scale space, and their similarity to x-corners ---


def saddle_points(image: Array32, kernels: Array32, flatter: float, weakest: float) -> tuple[Indices, Array32, Array32]:
    """Local extrema of saddle strength, row by row: flat indices, (Lxx - Lyy) / 2 and Lxy there.

    image : (rows >= 5, columns >= 5) float32
    kernels : (3, 5) float32 Gaussian and its first two derivatives, from the middle on
    flatter : greatest mean curvature over strength
    weakest : least strength
    """
    g, d, dd = (np.concatenate([sign * k[:0:-1], k]) for k, sign in zip(kernels, (1, -1, 1), strict=True))
    xx, yy, xy = (
        np.asarray(cv2.sepFilter2D(image, cv2.CV_32F, across, down, borderType=cv2.BORDER_REFLECT_101), np.float32)
        for across, down in ((dd, g), (g, dd), (d, d))
    )
    half, mean = np.asarray((xx - yy) / 2, np.float32), ((xx + yy) / 2) ** 2
    squared = half**2 + xy**2
    peak = squared - mean == cv2.dilate(squared - mean, np.ones((3, 3)))
    fit = peak & (mean < np.float32(flatter**2) * squared) & (squared > np.float32(weakest**2))
    index = np.flatnonzero(fit)[: image.size // 4].astype(np.int64)
    return index, half.ravel()[index], xy.ravel()[index]


def ring_purity(image: Array32, index: Indices, radius: float, off_centre: float) -> Array32:
    """Share of the second harmonic in the remaining variance on a ring of eight samples around pixels (n,).

    index : (n,) int64 pixels of the picture, flattened
    radius : radius of the ring, in pixels
    off_centre : share of the first harmonic that is subtracted from the variance
    """
    row, column = (one[:, None] for one in np.divmod(index, image.shape[1]))
    turn = np.arange(8) * np.pi / 4
    places = [row + radius * np.sin(turn), column + radius * np.cos(turn)]
    ring = ndimage.map_coordinates(image, places, np.float64, order=1, mode="nearest")
    power = np.abs(np.fft.fft(ring)) ** 2 / 8
    rest = power[:, 1:].sum(axis=1) - 2 * off_centre * power[:, 1]
    return np.asarray(2 * power[:, 2] / np.maximum(rest, 1e-30), np.float32)


def best_of_tiles(index: Indices, shape: tuple[int, int], merits: Array, side: int, most: int) -> Indices:
    """Indices of the best pixels (n,), equally many from every tile, `most` in total or just more."""
    row, column = np.divmod(index, shape[1])
    tile = row // side * shape[1] + column // side
    order = np.lexsort((merits, tile))
    better = np.searchsorted(tile[order], tile[order], side="right") - 1 - np.arange(len(index))
    kept = np.cumsum(np.bincount(better, minlength=1))  # with so many better ones in their tile, or fewer
    each = np.searchsorted(kept, min(most, len(index))) + 1 if most else 0
    return np.asarray(order[better < each])


# --- Cubic B-splines of band-limited images: their spectra, and their values through a smooth map ---


def add_band(
    cut: Complex64, spectrum: Complex64, filter_y: Complex64, filter_x: Complex64, J: Array, limit: float
) -> None:
    """Add a lattice's spectrum (n, n), repeated and filtered, inside the band; the filters' frequencies are centred
    along y and begin with zero along x."""
    n, ky, kx = len(spectrum), np.arange(len(filter_y)) - len(filter_y) // 2, np.arange(len(filter_x))
    x, y = (np.abs(np.add.outer(along[1] * ky, along[0] * kx)) <= limit * n for along in J.T)
    cut[np.ix_(ky, kx)] += (x & y) * spectrum[np.ix_(ky % n, kx % n)] * np.outer(filter_y, filter_x)


def read_spline(
    coefficients: Array32, H: Array, centre: Array, radius: float, displacement: Array, start: Array, step: float,
    shape: tuple[int, int],
) -> Array32:  # fmt: skip
    """See `procedures.numerics.splines.read_spline`."""
    px, py = np.meshgrid(*(start[axis] + step * np.arange(n) for axis, n in enumerate(shape[::-1])))
    x, y = (px - centre[0]) / radius, (py - centre[1]) / radius
    powers = np.stack([x, y, x**2, x * y, y**2, x**3, x**2 * y, x * y**2, y**3])
    dx, dy = np.tensordot(displacement, powers, 1)
    gx, gy, w = np.tensordot(H, np.stack([px + dx, py + dy, np.ones(shape)]), 1)
    places = [np.clip(g / w, 1, n - 2.001) for g, n in zip((gy, gx), coefficients.shape, strict=True)]
    return np.asarray(ndimage.map_coordinates(coefficients, places, np.float32, order=3, prefilter=False))


def folded_product(transform: Complex64, spectrum: Array32, s: int) -> Complex64:
    """The product (rows, c) of two half planes, its s bands of rows / s added: (rows / s, c)."""
    return np.asarray((transform * spectrum).reshape(s, -1, transform.shape[1]).sum(axis=0))
