"""Candidate x-corners in a picture: its saddle points, each with the axis along which it is dark.

An x-corner is a saddle of grey levels at every scale from the blur up to half a block, whatever the roll, so
saddles of one small scale at each level of a pyramid are enough.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

SCALE = 0.8
"""Standard deviation of the Gaussian whose second derivatives are taken, in pixels of the level."""
KERNEL_RADIUS = 3
SEPARATION = 2
"""Saddles closer than this (Chebyshev, pixels of the level) are one."""
ISOTROPY = 0.75
"""Greatest mean curvature of a saddle, relative to its curvature difference: 0 for an ideal x-corner, 1 for an edge."""
TILE = 64
TILE_KEEPS = 24
"""Strongest saddles kept in each tile of TILE x TILE pixels: textures yield thousands, a chart twelve."""
STRIP_ROWS = 256
"""Rows worked on at a time, so that the intermediate maps stay in the processor's cache."""


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

    points: npt.NDArray[np.complex128]
    axes: npt.NDArray[np.complex128]
    strengths: npt.NDArray[np.float64]

    def take(self, chosen: npt.NDArray[np.generic]) -> Saddles:
        """The chosen ones, by index or by mask."""
        return Saddles(self.points[chosen], self.axes[chosen], self.strengths[chosen])


def _kernels() -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Sampled Gaussian and its first two derivatives, with exact moments 0, 1 and 2."""
    x = np.arange(-KERNEL_RADIUS, KERNEL_RADIUS + 1, dtype=np.float64)
    g = np.exp(-0.5 * (x / SCALE) ** 2)
    g /= g.sum()
    first = x * g
    first /= first @ x
    second = (x**2 - g @ x**2) * g
    second *= 2 / (second @ x**2)
    return g.astype(np.float32), first.astype(np.float32), second.astype(np.float32)


def _strip_saddles(
    strip: npt.NDArray[np.float32],
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], npt.NDArray[np.complex128]]:
    """Rows and columns of the local maxima of saddle strength, and (Lxx - Lyy) / 2 + i Lxy there."""
    g, d, dd = _kernels()
    xx = cv2.sepFilter2D(strip, cv2.CV_32F, dd, g)
    yy = cv2.sepFilter2D(strip, cv2.CV_32F, g, dd)
    xy = cv2.sepFilter2D(strip, cv2.CV_32F, d, d)
    mean, half = (xx + yy) * np.float32(0.5), (xx - yy) * np.float32(0.5)
    squared = half * half + xy * xy
    determinant = squared - mean * mean
    size = 2 * SEPARATION + 1
    peaks = determinant >= cv2.dilate(determinant, np.ones((size, size), np.uint8))
    peaks &= mean * mean < np.float32(ISOTROPY**2) * squared
    rows, columns = np.nonzero(peaks)
    return rows, columns, half[rows, columns].astype(np.float64) + 1j * xy[rows, columns]


def _strongest_per_tile(points: npt.NDArray[np.complex128], strengths: npt.NDArray[np.float64]) -> npt.NDArray[np.intp]:
    """Indices of the TILE_KEEPS strongest points of each tile."""
    tiles = (points.imag // TILE).astype(np.int64) * (1 << 20) + (points.real // TILE).astype(np.int64)
    order = np.lexsort((-strengths, tiles))
    starts = np.flatnonzero(np.r_[True, np.diff(tiles[order]) != 0])
    rank = np.arange(len(order)) - np.repeat(starts, np.diff(np.r_[starts, len(order)]))
    return order[rank < TILE_KEEPS]


def find_saddles(image: npt.NDArray[np.float32]) -> Saddles:
    """The saddle points of a picture, the strongest of each neighbourhood, in no order.

    A saddle of the Gaussian scale space: Lxx Lyy - Lxy^2 < 0 at a local extremum, with curvatures of nearly equal
    size and opposite sign, as between two black and two white quadrants.

    Parameters
    ----------
    image : (rows, columns) float32
        Grey levels; any positive scale gives the same points.
    """
    pad = KERNEL_RADIUS + SEPARATION
    rows = image.shape[0]
    found = []
    for top in range(0, rows, STRIP_ROWS):
        first, last = max(top - pad, 0), min(top + STRIP_ROWS + pad, rows)
        y, x, z = _strip_saddles(image[first:last])
        own = (y + first >= top) & (y + first < top + STRIP_ROWS)
        found.append((x[own] + 1j * (y[own] + first), z[own]))
    points = np.concatenate([p for p, _ in found])
    curvatures = np.concatenate([z for _, z in found])
    strengths = np.abs(curvatures)
    keep = _strongest_per_tile(points, strengths)
    keep = keep[strengths[keep] > 1e-6 * strengths.max(initial=0.0)]
    return Saddles(points[keep], -curvatures[keep] / strengths[keep], strengths[keep])
