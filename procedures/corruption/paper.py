"""Noise of flat paper and of a fit's residual, from which a camera's sharpening is detected."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from procedures.corruption.noise import Variogram
from procedures.numerics.arrays import Array

SQUARE = 7
"""Side in pixels of the squares that are tested for flatness."""
FLAT_RANGE = (0.3, 2.0)
"""Range of the variance of a flat square about its plane, relative to that of noise. It scatters by a fifth; edges and
clipped levels lie farther off. All frequencies contribute equally, so the selection does not colour the noise. About
the mean instead of a plane, uneven light would contribute, and select noise that happens to oppose its slope."""
SLOPE = np.arange(SQUARE) - SQUARE // 2
LEVELS, TENTH = 8, 0.74
"""Classes of levels of a picture; tenth percentile of the variance of flat squares, relative to that of the noise."""
OVERLAP = 9 / 4
"""Variance of a mean of squared differences of 2 x 2 neighbours, over that of as many disjoint ones."""


@dataclass(frozen=True)
class NoiseMeasurement:
    """Traces of a camera's processing in the noise.

    finest : noise variance at the paper's finest detail, which no lens passes, over that expected there; uncertainty :
    standard uncertainty of `finest` by the number of pixels.
    """

    finest: float
    uncertainty: float
    paper: Variogram
    residual: Variogram


def measure_noise(
    picture: npt.NDArray[np.float32],
    levels: tuple[float, float],
    variance_at: Callable[[Array], Array],
    residual: Array,
) -> NoiseMeasurement:
    """Measure the noise of a picture's flat bright parts and of a fit's residual.

    picture : (rows, columns) float32
    levels : black and white
    variance_at : noise variance expected at levels between black (0) and white (1)
    left : (rows, columns) residual of a fit, NaN where there is none
    """
    paper, expected = _flat_paper(picture, levels, variance_at)
    of_fit = Variogram.of(residual, np.isfinite(residual))
    pairs = float(paper.pairs.max())
    finest, uncertainty = (paper.finest / expected, float(np.sqrt(2 * OVERLAP / pairs))) if pairs else (1.0, np.inf)
    return NoiseMeasurement(finest, uncertainty, paper, of_fit)


def flat_noise(picture: npt.NDArray[np.float32]) -> Variogram:
    """Variogram of a picture's flattest parts, of any level: there the noise is that of the flattest of this level."""
    centred = picture - picture.mean()
    mean, variance = _about_planes(centred)
    group = np.digitize(mean, np.quantile(mean, np.linspace(0, 1, LEVELS + 1)[1:-1]))
    least = [np.percentile(variance[group == one], 10) if np.any(group == one) else 0.0 for one in range(LEVELS)]
    expected = np.array(least)[group] / TENTH
    flat = (variance > FLAT_RANGE[0] * expected) & (variance < FLAT_RANGE[1] * expected)
    return Variogram.of(centred.astype(np.float64), flat)


def _flat_paper(
    picture: npt.NDArray[np.float32], levels: tuple[float, float], variance_at: Callable[[Array], Array]
) -> tuple[Variogram, float]:
    """Variogram of the parts that are flat and nearer to white than to black, and the variance expected there."""
    black, white = levels
    from_white = picture - np.float32(white)
    mean, variance = _about_planes(from_white)
    expected = variance_at(np.asarray(1 + mean / (white - black), dtype=np.float64))
    flat = (variance > FLAT_RANGE[0] * expected) & (variance < FLAT_RANGE[1] * expected) & (mean > (black - white) / 2)
    expected_variance = float(expected[flat].mean()) if flat.any() else 1.0
    return Variogram.of(np.asarray(from_white, dtype=np.float64), flat), expected_variance


def _about_planes(picture: npt.NDArray[np.float32]) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Mean of every square, and its variance about its plane."""
    mean, square = (np.asarray(cv2.blur(one, (SQUARE, SQUARE)), np.float32) for one in (picture, picture * picture))
    return mean, square - mean * mean - _slope_variance(picture)


def _slope_variance(picture: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Part of the variance of every square that is due to its slopes along rows and columns."""
    spread = float(np.mean(SLOPE**2))
    along, across = SLOPE / (spread * SQUARE), np.full(SQUARE, 1 / SQUARE)
    slopes = [cv2.sepFilter2D(picture, cv2.CV_32F, *pair) for pair in ((along, across), (across, along))]
    return np.float32(spread) * (slopes[0] * slopes[0] + slopes[1] * slopes[1])
