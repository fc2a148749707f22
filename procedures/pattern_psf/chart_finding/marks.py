"""Candidate x-corners in a picture: its saddle points, each with the axis along which it is dark.

An x-corner is a saddle of grey levels at every scale from the blur up to half a block, whatever the roll, so
saddles of one small scale at each level of a pyramid are enough.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from procedures.numerics.ordered import quantile
from procedures.pattern_psf.chart_finding.saddle_kernels import best_of_tiles, ring_purity, saddles
from procedures.pattern_psf.chart_finding.spatial_bins import field_of, unrivalled

SCALE = 1.25
"""Standard deviation of the Gaussian whose second derivatives are taken, in pixels of the level."""
KERNEL_RADIUS = 4
ISOTROPY = 0.9
"""Greatest mean curvature of a saddle, relative to its curvature difference: 0 for an ideal x-corner, 1 for an edge."""
ABOVE_NOISE = 4.0
"""Least strength of a saddle, in root mean squares of the strength that the noise has."""
HIGH_PASS = np.outer([1, -2, 1], [1, -2, 1]).astype(np.float32)
QUIET_TILE = 16
QUIET = 0.01
"""The quiet share of the places, of QUIET_TILE pixels square, where noise is measured."""
RING_RADIUS = 2.0
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
NOISE_BANDS = 128
"""Rows from one band in which noise is measured to the next."""
Picture = npt.NDArray[np.float32]
Complex = npt.NDArray[np.complex128]
Indices = npt.NDArray[np.int64]


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


def _kernels() -> Picture:
    """Sampled Gaussian and its first two derivatives, with exact moments 0, 1 and 2, from the middle on, (3, 5)."""
    x = np.arange(-KERNEL_RADIUS, KERNEL_RADIUS + 1, dtype=np.float64)
    g = np.exp(-0.5 * (x / SCALE) ** 2)
    g /= g.sum()
    first = x * g
    first /= first @ x
    second = (x**2 - g @ x**2) * g
    second *= 2 / (second @ x**2)
    return np.array([g, first, second], dtype=np.float32)[:, KERNEL_RADIUS:]


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
    return float(np.sqrt(quantile(energy, QUIET) / (HIGH_PASS**2).sum())) if len(energy) else 0.0


def _noise_gain() -> float:
    """Root mean square strength that white noise of unit standard deviation has."""
    right = _kernels().astype(np.float64)
    g, d, dd = (np.concatenate([sign * k[:0:-1], k]) for k, sign in zip(right, (1, -1, 1), strict=True))
    half = (np.outer(dd, g) - np.outer(g, dd)) / 2
    return float(np.sqrt((half**2).sum() + (np.outer(d, d) ** 2).sum()))


def find_saddles(image: Picture) -> Saddles:
    """The saddle points of a picture that stand out of its noise and look like x-corners, in no order.

    A saddle of the Gaussian scale space: Lxx Lyy - Lxy^2 < 0 at a local extremum, with curvatures of nearly equal
    size and opposite sign, as between two black and two white quadrants.

    Parameters
    ----------
    image : (rows, columns) float32
        Grey levels; any positive scale gives the same points.
    """
    most = int(min(MOST, np.sqrt(CROWDING * image.size)))
    weakest = ABOVE_NOISE * _noise_gain() * _noise(image)
    index, half, xy = saddles(image, _kernels(), ISOTROPY, weakest)
    z = np.asarray(-half - 1j * xy, dtype=np.complex128)
    kept = best_of_tiles(index, image.shape, np.abs(z), TILE, IMPURE * most)
    index, z = index[kept], z[kept]
    purity = ring_purity(image, index, RING_RADIUS, OFF_CENTRE)
    merits = np.abs(z) * np.where(purity > PURITY, purity, 0) ** 2
    kept = best_of_tiles(index, image.shape, merits, TILE, most)
    kept = kept[merits[kept] > 0]
    strengths = np.abs(z[kept])
    found = Saddles(index[kept] % image.shape[1] + 1j * (index[kept] // image.shape[1]), z[kept] / strengths, strengths)
    if not len(kept):
        return found
    field, order = field_of(found.points, found.axes, merits[kept], RIVAL)
    return found.take(order[unrivalled(field, RIVAL, SAME_AXIS)])
