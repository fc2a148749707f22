"""Candidate x-corners in a picture: its saddle points, each with the axis along which it is dark.

An x-corner is a saddle of grey levels at every scale from the blur up to half a block, whatever the roll, so
saddles of one small scale at each level of a pyramid are enough.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

SCALE = 1.1
"""Standard deviation of the Gaussian whose second derivatives are taken, in pixels of the level."""
KERNEL_RADIUS = 4
SEPARATION = 1
"""Saddles closer than this (Chebyshev, pixels of the level) are one."""
ISOTROPY = 0.9
"""Greatest mean curvature of a saddle, relative to its curvature difference: 0 for an ideal x-corner, 1 for an edge."""
ABOVE_NOISE = 1.5
"""Least strength, in median strengths of the saddles of the quiet fifth of the picture, which are noise."""
RUN = 64
"""Neighbouring saddles whose median strength tells a quiet place from a busy one."""
RING_RADIUS = 1.8
RING_SAMPLES = 8
PURITY = 0.45
"""Least share of the second harmonic in the variance around a saddle: 1 for an ideal x-corner, 2/7 for noise."""
TILE = 64
"""Side of the squares from which the strongest saddles are taken when there are too many."""
MOST = 40_000
"""Saddles kept in one picture: textures yield hundreds of thousands, a chart twelve."""
STRIP_ROWS = 128
"""Rows worked on at a time, so that the intermediate maps stay in the processor's cache."""
Picture = npt.NDArray[np.float32]
Complex = npt.NDArray[np.complex128]
Indices = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Saddles:
    """Saddle points of one level of the pyramid.

    Attributes
    ----------
    points : (n,) complex128
        x + iy in pixels of the level.
    axes : (n,) complex128
        Unit numbers whose angle is twice that of the dark axis (an axis has no sign).
    strengths : (n,) float64
        Curvature difference, in grey levels per squared pixel.
    """

    points: Complex
    axes: Complex
    strengths: npt.NDArray[np.float64]

    def take(self, chosen: npt.NDArray[np.generic]) -> Saddles:
        """The chosen ones, by index or by mask."""
        return Saddles(self.points[chosen], self.axes[chosen], self.strengths[chosen])


def _kernels() -> tuple[Picture, Picture, Picture]:
    """Sampled Gaussian and its first two derivatives, with exact moments 0, 1 and 2."""
    x = np.arange(-KERNEL_RADIUS, KERNEL_RADIUS + 1, dtype=np.float64)
    g = np.exp(-0.5 * (x / SCALE) ** 2)
    g /= g.sum()
    first = x * g
    first /= first @ x
    second = (x**2 - g @ x**2) * g
    second *= 2 / (second @ x**2)
    return g.astype(np.float32), first.astype(np.float32), second.astype(np.float32)


def _strip_saddles(strip: Picture) -> tuple[Indices, Picture, Picture]:
    """Flat indices of the local maxima of saddle strength, with (Lxx - Lyy) / 2 and Lxy there."""
    g, d, dd = _kernels()
    xx = cv2.sepFilter2D(strip, cv2.CV_32F, dd, g)
    yy = cv2.sepFilter2D(strip, cv2.CV_32F, g, dd)
    xy = cv2.sepFilter2D(strip, cv2.CV_32F, d, d)
    mean, half = (xx + yy) * np.float32(0.5), (xx - yy) * np.float32(0.5)
    squared = half * half + xy * xy
    mean *= mean
    determinant = squared - mean
    size = 2 * SEPARATION + 1
    peaks = determinant >= cv2.dilate(determinant, np.ones((size, size), np.uint8))
    peaks &= mean < np.float32(ISOTROPY**2) * squared
    index = np.flatnonzero(peaks)
    return index, half.ravel()[index], xy.ravel()[index]


def _strips(image: Picture) -> Iterator[tuple[Indices, Picture, Picture]]:
    """The saddles of a picture, strip by strip; indices are those of the whole, flattened."""
    pad = KERNEL_RADIUS + SEPARATION
    rows, columns = image.shape
    for top in range(0, rows, STRIP_ROWS):
        first, last = max(top - pad, 0), min(top + STRIP_ROWS + pad, rows)
        index, half, xy = _strip_saddles(image[first:last])
        begin, end = np.searchsorted(index, [(top - first) * columns, (top - first + STRIP_ROWS) * columns])
        yield index[begin:end] + first * columns, half[begin:end], xy[begin:end]


def _noise_level(strengths: npt.NDArray[np.floating]) -> float:
    """Median strength of the saddles in the quiet fifth of the picture; they come in its order."""
    runs = strengths[: len(strengths) // RUN * RUN].reshape(-1, RUN)[:: 1 + len(strengths) // (4096 * RUN)]
    return float(np.quantile(np.median(runs, axis=1), 0.2)) if len(runs) else 0.0


def _purity(image: Picture, points: Complex) -> npt.NDArray[np.float64]:
    """Share of the second harmonic in the variance on a ring around each point."""
    turns = np.exp(2j * np.pi * np.arange(RING_SAMPLES) / RING_SAMPLES)
    purity = np.empty(len(points))
    for begin in range(0, len(points), 1 << 14):  # remap takes no maps of more than 2^15 rows
        part = slice(begin, begin + (1 << 14))
        ring = points[part, None] + RING_RADIUS * turns
        around = cv2.remap(image, ring.real.astype(np.float32), ring.imag.astype(np.float32), cv2.INTER_LINEAR,
                           borderMode=cv2.BORDER_REPLICATE)  # fmt: skip
        deviation = around - around.mean(axis=1, keepdims=True)
        harmonic = np.abs(deviation @ turns.conj() ** 2) ** 2 * (2 / RING_SAMPLES)
        purity[part] = harmonic / np.maximum((deviation**2).sum(axis=1), np.finfo(np.float32).tiny)
    return purity


def _best_of_tiles(points: Complex, merit: npt.NDArray[np.float64], most: int) -> Indices:
    """Indices of the points of most merit, as many from every tile as make `most` in all if tiles are full."""
    tiles = (points.imag // TILE).astype(np.int64) * (1 << 20) + (points.real // TILE).astype(np.int64)
    order = np.lexsort((-merit, tiles))
    starts = np.flatnonzero(np.r_[True, np.diff(tiles[order]) != 0])
    rank = np.arange(len(order)) - np.repeat(starts, np.diff(np.r_[starts, len(order)]))
    each = np.sort(rank)[most]
    return order[rank <= each]


def find_saddles(image: Picture, *, most: int = MOST) -> Saddles:
    """The saddle points of a picture that stand out of its noise and look like x-corners, in no order.

    A saddle of the Gaussian scale space: Lxx Lyy - Lxy^2 < 0 at a local extremum, with curvatures of nearly equal
    size and opposite sign, as between two black and two white quadrants.

    Parameters
    ----------
    image : (rows, columns) float32
        Grey levels; any positive scale gives the same points.
    most : int
        About how many are kept.
    """
    strips = list(_strips(image))
    index, half, xy = (np.concatenate([strip[n] for strip in strips]) for n in range(3))
    strengths = np.hypot(half, xy)
    strong = np.flatnonzero(strengths > max(ABOVE_NOISE * _noise_level(strengths), 1e-5 * strengths.max(initial=0.0)))
    points = index[strong] % image.shape[1] + 1j * (index[strong] // image.shape[1])
    purity = _purity(image, points)
    pure = purity > PURITY
    points, strong, purity = points[pure], strong[pure], purity[pure]
    if len(points) > most:
        keep = _best_of_tiles(points, strengths[strong] * purity**2, most)
        points, strong = points[keep], strong[keep]
    z = half[strong] + 1j * xy[strong].astype(np.float64)
    return Saddles(points, -z / np.abs(z), np.abs(z))
