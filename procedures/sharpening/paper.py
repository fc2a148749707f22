"""The noise of flat paper, and of what a fit left of a photograph: what a camera's sharpening does to them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from procedures.sharpening.noise import Sharpening, Variogram, find_sharpening

Array = npt.NDArray[np.float64]

SQUARE = 7
"""Pixels along the side of a square that is flat or not."""
CALM = (0.3, 2.0)
"""Variance about the plane of such a square over that of noise where it is flat. It scatters by a fifth; an edge or a
clipped level is farther away. As it is of all detail alike, the choice colours no noise. About the mean, light that
falls off over the chart would be part of it, and what is chosen then is noise that happens to go against the slope."""
SLOPE = np.arange(SQUARE) - SQUARE // 2
OVERLAP = 9 / 4
"""Variance of a mean of squared differences of 2 x 2 neighbours, over that of as many without a pixel in common."""


@dataclass(frozen=True)
class NoiseLook:
    """What noise tells of a camera's processing.

    Attributes
    ----------
    sharpening : Sharpening
    finest : float
        Noise variance of the paper's finest detail, which no lens passes, over that expected there.
    uncertainty : float
        Standard uncertainty of that by the count of pixels.
    """

    sharpening: Sharpening
    finest: float
    uncertainty: float


def look_at_noise(
    picture: npt.NDArray[np.float32], levels: tuple[float, float], variance_at: Callable[[Array], Array], left: Array
) -> NoiseLook:
    """The noise of a picture's flat bright parts and of what a fit left.

    Parameters
    ----------
    picture : (rows, columns) float32
    levels : (float, float)
        Black and white in it.
    variance_at : callable
        Noise variance expected at levels between black (0) and white (1).
    left : (rows, columns) float64
        What a fit left of white noise, NaN where it was not fitted.
    """
    paper, expected = _flat_paper(picture, levels, variance_at)
    look = find_sharpening([paper, Variogram.of(left, np.isfinite(left), left=True)])
    pairs = float(paper.pairs.max())
    if not pairs:
        return NoiseLook(look, 1.0, np.inf)
    return NoiseLook(look, paper.finest / expected, float(np.sqrt(2 * OVERLAP / pairs)))


def _flat_paper(
    picture: npt.NDArray[np.float32], levels: tuple[float, float], variance_at: Callable[[Array], Array]
) -> tuple[Variogram, float]:
    """Of what is flat and nearer to white than to black, and the variance expected there."""
    black, white = levels
    from_white = picture - np.float32(white)
    mean = cv2.blur(from_white, (SQUARE, SQUARE))
    variance = cv2.blur(from_white * from_white, (SQUARE, SQUARE)) - mean * mean - _of_slope(from_white)
    expected = variance_at(np.asarray(1 + mean / (white - black), dtype=np.float64))
    flat = (variance > CALM[0] * expected) & (variance < CALM[1] * expected) & (mean > (black - white) / 2)
    there = float(expected[flat].mean()) if flat.any() else 1.0
    return Variogram.of(np.asarray(from_white, dtype=np.float64), flat), there


def _of_slope(picture: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """The part of the variance in every square that its slopes along rows and columns are."""
    spread = float(np.mean(SLOPE**2))
    along, across = SLOPE / (spread * SQUARE), np.full(SQUARE, 1 / SQUARE)
    slopes = [cv2.sepFilter2D(picture, cv2.CV_32F, *pair) for pair in ((along, across), (across, along))]
    return np.float32(spread) * (slopes[0] * slopes[0] + slopes[1] * slopes[1])
