"""Noise of a photograph's samples as a function of level, estimated from the photograph alone.

In flat parts of a scene the variation is noise: variance = a + b level, of read-out and photons. Mixed second
differences eliminate slopes (Immerkaer 1996); of the blocks at one level the quietest are used.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import nnls

from procedures.outcome import BadInput
from procedures.raw import Plane
from procedures.reading.development import Development

Array = npt.NDArray[np.float64]
Single = npt.NDArray[np.float32]

BLOCK = 8
"""Samples along a block's side."""
BANDS = 12
"""Number of levels at which the variance is estimated."""
QUIET, QUIET_FACTOR = 0.1, 0.63
"""Fraction of a level's blocks below the variance used, and that variance over the mean for white noise, from 66 000
simulated blocks."""
WHITE = 0.87
"""Variance of fourth over second differences in the quietest blocks of white noise, from the same simulation."""
FINE = (1.0, -2.0, 1.0), (1.0, -4.0, 6.0, -4.0, 1.0)
"""Difference filters of equal variance for white noise, once normalised."""
MOST_BLOCKS = 60_000
BRIGHT = 0.97
"""Blocks above this level are excluded, as their brightest samples may be clipped."""


@dataclass(frozen=True)
class Noise:
    """Variance of a plane's samples as a function of level: `read` + `slope` level, white = 1.

    read, slope : float
    whiteness : float
        Variance of fourth over second differences in the quietest blocks, relative to white noise: 1 for a sensor's
        samples, less where neighbours were mixed.
    rise : float
        Variance in the brightest quarter of the levels over that in the darkest: below 1 after a tone curve.
    growth : float
        Exponent with which the variance grows with light between these quarters: 0 for read-out noise, 1 for photons.
    """

    read: float
    slope: float
    whiteness: float
    rise: float
    growth: float = 0.0

    def variance_at(self, level: npt.NDArray[np.floating]) -> Single:
        """Variance at given levels."""
        return np.asarray(self.read + self.slope * np.maximum(level, 0), dtype=np.float32)


def with_coding(noise: Noise, development: Development) -> Noise:
    """The noise of a developed picture's samples with the error of rounding and coding, a line over the levels."""
    levels = np.linspace(0.02, 0.9, BANDS)
    error = development.light_error(levels).astype(np.float64) ** 2
    design = np.column_stack([np.ones_like(levels), levels]) / error[:, None]
    read, slope = nnls(design, np.ones_like(levels))[0]
    return replace(noise, read=noise.read + float(read), slope=noise.slope + float(slope))


def noise_of(plane: Plane) -> Noise:
    """Noise of a plane's samples, at least that of quantisation. Raises BadInput for a plane without a block inside."""
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
    brighter = np.median(levels[-quarter:]) / max(float(np.median(levels[:quarter])), 1e-6)
    growth = float(np.log(rise) / np.log(brighter)) if brighter > 1 else 0.0
    whiteness = float(fourth[quiet].mean() / max(second[quiet].mean(), 1e-30)) / WHITE
    return Noise(max(float(read), floor), float(slope), whiteness, rise, growth)


def _blocks(samples: Single) -> tuple[Array, Array, Array]:
    """Mean level and mean squares of second and fourth differences of blocks over the plane."""
    import cv2

    rows, columns = (size // BLOCK * BLOCK for size in samples.shape)
    if min(rows, columns) < (least := 3 * BLOCK):
        size = f"{samples.shape[1]} x {samples.shape[0]}"
        reason = f"noise is estimated from planes of {least} x {least} pixels or more; got {size}"
        raise BadInput(reason, "give a larger photograph")
    images = [samples[:rows, :columns]]
    for taps in (np.array(difference) / np.linalg.norm(difference) for difference in FINE):
        fine = cv2.sepFilter2D(samples, cv2.CV_32F, taps, taps)[:rows, :columns]
        images.append(fine * fine)
    level, *powers = (_block_means(image)[1:-1, 1:-1].ravel() for image in images)
    used = np.flatnonzero((level < BRIGHT) & np.isfinite(level))
    used = used[:: max(1, len(used) // MOST_BLOCKS)]
    if len(used) == 0:
        used = np.arange(len(level))
    return level[used], powers[0][used], powers[1][used]


def _block_means(values: Single) -> Array:
    rows, columns = values.shape
    blocks = values.reshape(rows // BLOCK, BLOCK, columns // BLOCK, BLOCK)
    return np.asarray(blocks.mean(axis=(1, 3)), dtype=np.float64)
