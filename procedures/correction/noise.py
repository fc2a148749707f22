"""How noisy the samples of a photograph are at every level, told from the photograph alone.

Where a scene is flat, what varies from sample to sample is noise: variance = a + b level, of reading and of photons.
Mixed second differences leave flat slopes out (Immerkaer 1996); of the blocks at one level the quietest are believed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import nnls

from procedures.raw import Plane

Array = npt.NDArray[np.float64]
Single = npt.NDArray[np.float32]

BLOCK = 8
"""Samples along a block's side."""
BANDS = 12
"""Levels at which variance is told."""
QUIET, QUIET_FACTOR = 0.1, 0.63
"""Share of a level's blocks that lie under the variance taken, and that variance over the mean of white noise alone:
of 66 000 simulated blocks."""
WHITE = 0.87
"""Fourth differences' variance over second ones' in the quietest blocks of white noise, of the same simulation."""
FINE = (1.0, -2.0, 1.0), (1.0, -4.0, 6.0, -4.0, 1.0)
"""Differences whose variances are the same for white noise, once normalised."""
MOST_BLOCKS = 60_000
BRIGHT = 0.97
"""Levels of blocks from here on are left out: their brightest samples may be clipped."""


@dataclass(frozen=True)
class Noise:
    """Variance of the samples of a plane at their level: `read` + `slope` level, white = 1.

    Attributes
    ----------
    read, slope : float
    whiteness : float
        Variance of fourth differences in the quietest blocks over that of second ones, both as white noise has them:
        1 for samples as a sensor gives them, less where neighbours were mixed.
    rise : float
        Variance in the brightest quarter of the levels over that in the darkest: under 1 where a curve took light back.
    """

    read: float
    slope: float
    whiteness: float
    rise: float

    def variance_at(self, level: npt.NDArray[np.floating]) -> Single:
        """Variance at those levels."""
        return np.asarray(self.read + self.slope * np.maximum(level, 0), dtype=np.float32)


def noise_of(plane: Plane) -> Noise:
    """The noise of a plane's samples; at least that of rounding to its digital numbers."""
    level, second, fourth = _blocks(plane.samples)
    floor = plane.quantisation**2 / 12
    bands = np.array_split(np.argsort(level), min(BANDS, max(len(level) // 40, 1)))
    levels = np.array([level[band].mean() for band in bands])
    variances = np.array([max(float(np.quantile(second[band], QUIET)) / QUIET_FACTOR, floor) for band in bands])
    design = np.column_stack([np.ones_like(levels), np.maximum(levels, 0)]) / variances[:, None]
    read, slope = nnls(design, np.ones_like(levels))[0]
    quiet = np.concatenate([band[second[band] <= np.quantile(second[band], QUIET)] for band in bands])
    quarter = max(len(bands) // 4, 1)
    rise = float(np.median(variances[-quarter:]) / np.median(variances[:quarter]))
    whiteness = float(fourth[quiet].mean() / max(second[quiet].mean(), 1e-30)) / WHITE
    return Noise(max(float(read), floor), float(slope), whiteness, rise)


def _blocks(samples: Single) -> tuple[Array, Array, Array]:
    """Of blocks over the plane: mean level, and mean squares of second and of fourth differences."""
    import cv2

    second, fourth = (_normalised(FINE[0], FINE[0]), _normalised(FINE[1], FINE[1]))
    rows, columns = (size // BLOCK * BLOCK for size in samples.shape)
    found = [samples[:rows, :columns]]
    for down, across in (second, fourth):
        fine = cv2.sepFilter2D(samples, cv2.CV_32F, across, down)[:rows, :columns]
        found.append(fine * fine)
    level, *powers = (_block_means(one)[1:-1, 1:-1].ravel() for one in found)
    kept = np.flatnonzero((level < BRIGHT) & np.isfinite(level))
    kept = kept[:: max(1, len(kept) // MOST_BLOCKS)]
    if len(kept) == 0:
        kept = np.arange(len(level))
    return level[kept], powers[0][kept], powers[1][kept]


def _normalised(down: tuple[float, ...], across: tuple[float, ...]) -> tuple[Array, Array]:
    return np.array(down) / np.linalg.norm(down), np.array(across) / np.linalg.norm(across)


def _block_means(values: Single) -> Array:
    rows, columns = values.shape
    blocks = values.reshape(rows // BLOCK, BLOCK, columns // BLOCK, BLOCK)
    return np.asarray(blocks.mean(axis=(1, 3)), dtype=np.float64)
