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
from scipy.spatial import cKDTree

SCALE = 1.25
"""Standard deviation of the Gaussian whose second derivatives are taken, in pixels of the level."""
KERNEL_RADIUS = 4
SEPARATION = 1
"""Saddles closer than this (Chebyshev, pixels of the level) are one."""
ISOTROPY = 0.9
"""Greatest mean curvature of a saddle, relative to its curvature difference: 0 for an ideal x-corner, 1 for an edge."""
ABOVE_NOISE = 4.0
"""Least strength of a saddle, in root mean squares of the strength that the noise has."""
HIGH_PASS = np.outer([1, -2, 1], [1, -2, 1]).astype(np.float32)
QUIET_TILE = 16
QUIET = 0.01
"""The quiet share of the places, of QUIET_TILE pixels square, where noise is measured."""
RING_RADIUS = 2.0
RING_SAMPLES = 8
OFF_CENTRE = 0.8
"""Share of the first harmonic that is excused: that of a ring whose centre is a fraction of a pixel off the saddle."""
PURITY = 0.62
"""Least share of the second harmonic in what remains of the variance around a saddle: 1 for an ideal x-corner."""
RIVAL = 3.0
"""Radius in which only the best of the saddles of like axis is kept: under half a block."""
SAME_AXIS = np.cos(2 * np.deg2rad(11))
"""Axes are alike when their angle is less than this: tilt and noise turn those of a chart by less."""
TILE = 32
"""Side of the squares from which the strongest saddles are taken when there are too many."""
MOST = 40_000
CROWDING = 400
"""Saddles kept in one picture: at most MOST, and so many that their square is CROWDING per pixel, because the pairs
of neighbours grow as that. Textures yield hundreds of thousands, a chart twelve."""
IMPURE = 4
"""How many times as many are kept before they are looked at closer."""
STRIP_PIXELS = 200_000
"""Pixels worked on at a time, so that the intermediate maps stay in the processor's cache."""
NOISE_BANDS = 128
"""Rows from one band in which noise is measured to the next."""
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


@dataclass(frozen=True)
class _Strip:
    """Local maxima of saddle strength in a strip: flat indices, (Lxx - Lyy) / 2 and Lxy there."""

    index: Indices
    half: Picture
    xy: Picture


def _strip_saddles(strip: Picture, weakest: float) -> _Strip:
    g, d, dd = _kernels()
    xx = cv2.sepFilter2D(strip, cv2.CV_32F, dd, g)
    yy = cv2.sepFilter2D(strip, cv2.CV_32F, g, dd)
    xy = np.asarray(cv2.sepFilter2D(strip, cv2.CV_32F, d, d), dtype=np.float32)
    mean, half = (xx + yy) * np.float32(0.5), (xx - yy) * np.float32(0.5)
    squared = half * half + xy * xy
    mean *= mean
    determinant = squared - mean
    size = 2 * SEPARATION + 1
    peaks = determinant >= cv2.dilate(determinant, np.ones((size, size), np.uint8))
    peaks &= mean < np.float32(ISOTROPY**2) * squared
    peaks &= squared > np.float32(weakest**2)
    index = np.flatnonzero(peaks)
    return _Strip(index, half.ravel()[index], xy.ravel()[index])


def _strips(image: Picture, weakest: float) -> Iterator[_Strip]:
    """The saddles of a picture stronger than the weakest, strip by strip; indices are those of the whole, flattened."""
    pad = KERNEL_RADIUS + SEPARATION
    rows, columns = image.shape
    height = max(STRIP_PIXELS // columns, 4 * pad)
    for top in range(0, rows, height):
        first, last = max(top - pad, 0), min(top + height + pad, rows)
        strip = _strip_saddles(image[first:last], weakest)
        own = slice(*np.searchsorted(strip.index, [(top - first) * columns, (top - first + height) * columns]))
        yield _Strip(strip.index[own] + first * columns, strip.half[own], strip.xy[own])


def _noise(image: Picture) -> float:
    """Standard deviation of white noise, from the highest frequencies in the quietest places.

    Light and blurred texture have little at the highest frequencies. Bands of rows are enough, and clipped places,
    without noise, are left out.
    """
    energies = []
    for top in range(0, image.shape[0] - QUIET_TILE - 1, NOISE_BANDS):
        band = cv2.filter2D(image[top : top + QUIET_TILE + 2], cv2.CV_32F, HIGH_PASS)[1:-1, 1:-1]
        tiles = (max(band.shape[1] // QUIET_TILE, 1), 1)
        energies.append(cv2.resize(band * band, tiles, interpolation=cv2.INTER_AREA).ravel())
    energy = np.concatenate(energies) if energies else np.zeros(0)
    energy = energy[energy > 1e-10 * energy.max(initial=0.0)]
    return float(np.sqrt(np.quantile(energy, QUIET) / (HIGH_PASS**2).sum())) if len(energy) else 0.0


def _noise_gain() -> float:
    """Root mean square strength that white noise of unit standard deviation has."""
    g, d, dd = (k.astype(np.float64) for k in _kernels())
    half = (np.outer(dd, g) - np.outer(g, dd)) / 2
    return float(np.sqrt((half**2).sum() + (np.outer(d, d) ** 2).sum()))


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
        first, second = (np.abs(deviation @ turns.conj() ** n) ** 2 * (2 / RING_SAMPLES) for n in (1, 2))
        rest = (deviation**2).sum(axis=1) - OFF_CENTRE * first
        purity[part] = second / np.maximum(rest, np.finfo(np.float32).tiny)
    return purity


def _best_of_tiles(points: Complex, merit: npt.NDArray[np.float64], most: int) -> Indices:
    """Indices of the points of most merit, as many from every tile as make `most` in all."""
    if len(points) <= most:
        return np.arange(len(points))
    columns = int(points.real.max() // TILE) + 1
    tiles = points.imag // TILE * columns + points.real // TILE
    order = np.argsort(tiles - merit / (1.001 * merit.max()))  # merit is the fraction, so one key sorts by both
    starts = np.flatnonzero(np.diff(tiles[order], prepend=-1) != 0)
    rank = np.arange(len(order)) - np.repeat(starts, np.diff(starts, append=len(order)))
    each = np.partition(rank, most)[most]
    chosen: Indices = order[rank <= each]
    return chosen


def _unrivalled(saddles: Saddles, merit: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """Which saddles have none of more merit and like axis within RIVAL pixels."""
    tree = cKDTree(np.column_stack([saddles.points.real, saddles.points.imag]))
    i, j = tree.query_pairs(RIVAL, output_type="ndarray").T
    rivals = (saddles.axes[i] * saddles.axes[j].conj()).real > SAME_AXIS
    i, j = i[rivals], j[rivals]
    alone = np.ones(len(merit), dtype=np.bool_)
    alone[np.where(merit[i] < merit[j], i, j)] = False
    return alone


def find_saddles(image: Picture) -> Saddles:
    """The saddle points of a picture that stand out of its noise and look like x-corners, in no order.

    A saddle of the Gaussian scale space: Lxx Lyy - Lxy^2 < 0 at a local extremum, with curvatures of nearly equal
    size and opposite sign, as between two black and two white quadrants.

    Parameters
    ----------
    image : (rows, columns) float32
        Grey levels; any positive scale gives the same points.
    """
    strips = list(_strips(image, ABOVE_NOISE * _noise_gain() * _noise(image)))
    index, half, xy = (np.concatenate([getattr(s, name) for s in strips]) for name in ("index", "half", "xy"))
    points = index % image.shape[1] + 1j * (index // image.shape[1])
    z = half + 1j * xy.astype(np.float64)
    found = Saddles(points, -z / np.abs(z), np.abs(z))
    most = int(min(MOST, np.sqrt(CROWDING * image.size)))
    found = found.take(_best_of_tiles(found.points, found.strengths, IMPURE * most))
    purity = _purity(image, found.points)
    found, purity = found.take(purity > PURITY), purity[purity > PURITY]
    keep = _best_of_tiles(found.points, found.strengths * purity**2, most)
    found, purity = found.take(keep), purity[keep]
    return found.take(_unrivalled(found, found.strengths * purity**2))
