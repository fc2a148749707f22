"""Candidate x-corners of a picture: its saddle points, each with its dark axis.

An x-corner is a saddle of grey levels at every scale from the blur up to half a block, for any roll, so saddles of one
small scale at each level of a pyramid suffice.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from procedures.numerics import loops
from procedures.numerics.arrays import Array, Array32, Complex, field_of, quantile

SCALE = 1.25  # standard deviation of the Gaussian whose second derivatives are taken, in pixels of the level
KERNEL_RADIUS = 4
ISOTROPY = 0.9
"""Greatest mean curvature of a saddle, relative to its curvature difference: 0 for an ideal x-corner, 1 for an edge."""
ABOVE_NOISE = 4.0  # least strength of a saddle, relative to the rms strength by noise
HIGH_PASS = np.outer([1, -2, 1], [1, -2, 1]).astype(np.float32)
QUIET_TILE = 16
QUIET = 0.01  # quantile of the energies of squares of QUIET_TILE pixels at which noise is measured
RING_RADIUS = 2.0
OFF_CENTRE = 0.8  # share of the first harmonic that is subtracted: that of a ring a fraction of a pixel off the saddle
MIN_PURITY = 0.62
"""Least share of the second harmonic in the remaining variance around a saddle: 1 for an ideal x-corner."""
SUPPRESSION_RADIUS = 3.0  # radius of non-maximum suppression among saddles of similar axis: less than half a block
SAME_AXIS = np.cos(2 * np.deg2rad(11))
"""Least cosine of twice the angle between similar axes; tilt and noise turn those of a chart by less."""
TILE = 32  # side of the squares of which the strongest saddles are kept when there are too many
MAX_SADDLES = 40_000
MAX_SQUARE_PER_PIXEL = 400
"""Greatest number of saddles kept in one picture, and of their square per pixel, to which the number of neighbouring
pairs is proportional. Textures yield hundreds of thousands, a chart twelve."""
PRESELECTION_FACTOR = 4  # factor by which more saddles are kept before their purity is computed
NOISE_BAND_DISTANCE = 128  # distance between the bands of rows in which noise is measured


@dataclass(frozen=True)
class Saddles:
    """Saddle points of one level of the pyramid.

    points : (n,) complex128 x + iy in pixels of the level
    axes : (n,) complex128 unit complex numbers with twice the angle of the dark axis (an axis has no sign)
    strengths : (n,) curvature difference, in grey levels per squared pixel
    """

    points: Complex
    axes: Complex
    strengths: Array

    def take(self, chosen: npt.NDArray[np.generic]) -> "Saddles":
        """Subset by index or mask."""
        return Saddles(self.points[chosen], self.axes[chosen], self.strengths[chosen])


def _kernels() -> Array32:
    """Right halves (3, 5) of the sampled Gaussian and its first two derivatives, with exact moments 0, 1 and 2."""
    x = np.arange(-KERNEL_RADIUS, KERNEL_RADIUS + 1, dtype=np.float64)
    g = np.exp(-0.5 * (x / SCALE) ** 2)
    g /= g.sum()
    first = x * g
    first /= first @ x
    second = (x**2 - g @ x**2) * g
    second *= 2 / (second @ x**2)
    return np.array([g, first, second], dtype=np.float32)[:, KERNEL_RADIUS:]


def _noise_gain() -> float:
    """Rms strength of saddles by white noise of unit standard deviation."""
    right = _kernels().astype(np.float64)
    g, d, dd = (np.concatenate([sign * k[:0:-1], k]) for k, sign in zip(right, (1, -1, 1), strict=True))
    half = (np.outer(dd, g) - np.outer(g, dd)) / 2
    return float(np.sqrt((half**2).sum() + (np.outer(d, d) ** 2).sum()))


def find_saddles(image: Array32) -> Saddles:
    """Find the saddle points of a picture that exceed its noise and resemble x-corners, in no order.

    A saddle of the Gaussian scale space: Lxx Lyy - Lxy^2 < 0 at a local extremum, with curvatures of nearly equal
    size and opposite sign, as between two black and two white quadrants.

    image : (rows, columns) float32 grey levels, at any positive scale.
    """
    most = int(min(MAX_SADDLES, np.sqrt(MAX_SQUARE_PER_PIXEL * image.size)))
    # standard deviation of white noise, from the highest frequencies in the quietest unclipped places, where light and
    # blurred texture have little energy
    energies = []
    for top in range(0, image.shape[0] - QUIET_TILE - 1, NOISE_BAND_DISTANCE):
        band = cv2.filter2D(image[top : top + QUIET_TILE + 2], cv2.CV_32F, HIGH_PASS)[1:-1, 1:-1]
        tiles = (max(band.shape[1] // QUIET_TILE, 1), 1)
        energies.append(cv2.resize(band * band, tiles, interpolation=cv2.INTER_AREA).ravel())
    energy = np.concatenate(energies) if energies else np.zeros(0)
    energy = energy[energy > 1e-10 * energy.max(initial=0.0)]
    noise = float(np.sqrt(quantile(energy, QUIET) / (HIGH_PASS**2).sum())) if len(energy) else 0.0
    weakest = ABOVE_NOISE * _noise_gain() * noise
    index, half, xy = loops.saddle_points(image, _kernels(), ISOTROPY, weakest)
    z = np.asarray(-half - 1j * xy, dtype=np.complex128)
    kept = loops.best_of_tiles(index, image.shape, np.abs(z), TILE, PRESELECTION_FACTOR * most)
    index, z = index[kept], z[kept]
    purity = loops.ring_purity(image, index, RING_RADIUS, OFF_CENTRE)
    merits = np.abs(z) * np.where(purity > MIN_PURITY, purity, 0) ** 2
    kept = loops.best_of_tiles(index, image.shape, merits, TILE, most)
    kept = kept[merits[kept] > 0]
    strengths = np.abs(z[kept])
    candidates = Saddles(
        index[kept] % image.shape[1] + 1j * (index[kept] // image.shape[1]), z[kept] / strengths, strengths
    )
    if not len(kept):
        return candidates
    field, order = field_of(candidates.points, candidates.axes, merits[kept], SUPPRESSION_RADIUS)
    return candidates.take(order[loops.non_maximum_suppression(field, SUPPRESSION_RADIUS, SAME_AXIS)])
