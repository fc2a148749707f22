"""The noise of the paper around the chart and of what the fit left: what a camera's sharpening does to them."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from procedures.pattern import BLOCK, CELLS
from procedures.pattern_psf.radiometry import Light
from procedures.pattern_psf.refine import Fit
from procedures.pattern_psf.registration import Registration
from procedures.sharpened_noise import Sharpening, Variogram, find_sharpening

Array = npt.NDArray[np.float64]

SQUARE = 7
"""Pixels along the side of a square that is flat or not."""
CALM = (0.3, 2.0)
"""Variance in such a square over that of noise where it is flat. It scatters by a fifth; an edge or a clipped level is
farther away. As it is of all detail alike, the choice colours no noise."""


@dataclass(frozen=True)
class NoiseLook:
    """What the noise around the chart tells of the camera's processing.

    Attributes
    ----------
    sharpening : Sharpening
    finest : float
        Noise variance of the paper's finest detail, which no lens passes, over what `Light` expects there.
    uncertainty : float
        Standard uncertainty of that by the count of pixels.
    """

    sharpening: Sharpening
    finest: float
    uncertainty: float


def look_at_noise(samples: npt.NDArray[np.float32], light: Light, fit: Fit) -> NoiseLook:
    """The noise of a plane's flat paper around the chart and of the residual of the noise region."""
    paper, expected = _flat_paper(_around(samples, fit.registration), light)
    residual = Variogram.of(*_picture(fit), left=True)
    most = float(paper.pairs.max())
    # differences of four neighbours overlap: 9/4 of the variance of as many that do not
    uncertainty = float(np.sqrt(2 * 9 / 4 / most)) if most else np.inf
    finest = paper.finest / expected if most else 1.0
    return NoiseLook(find_sharpening([paper, residual]), finest, uncertainty)


def _around(samples: npt.NDArray[np.float32], registration: Registration) -> npt.NDArray[np.float32]:
    """The chart and half of its width around it."""
    low, high = -float(BLOCK), float(CELLS + BLOCK)
    rim = registration.to_sensor(np.array([[low, low], [high, low], [high, high], [low, high]]))
    first, last = rim.min(axis=0), rim.max(axis=0)
    wider = float((last - first).max()) / 2
    (left, top), (right, bottom) = (
        np.clip(place, 0, samples.shape[::-1]).astype(int) for place in (first - wider, last + wider)
    )
    return samples[top:bottom, left:right]


def _flat_paper(picture: npt.NDArray[np.float32], light: Light) -> tuple[Variogram, float]:
    """Of what is flat and nearer to white than to black, in units of white's noise, and the variance expected there."""
    from_white = picture - np.float32(light.white[0])
    mean = cv2.blur(from_white, (SQUARE, SQUARE))
    variance = cv2.blur(from_white * from_white, (SQUARE, SQUARE)) - mean * mean
    expected = light.variance_at(np.asarray(1 + mean / light.contrast, dtype=np.float64))
    flat = (variance > CALM[0] * expected) & (variance < CALM[1] * expected) & (mean > -light.contrast / 2)
    there = float(expected[flat].mean()) / light.variance_white if flat.any() else 1.0
    return Variogram.of(from_white / np.sqrt(light.variance_white), flat), there


def _picture(fit: Fit) -> tuple[Array, npt.NDArray[np.bool_]]:
    """The residual (rows, columns), and where it is known."""
    o = fit.observation
    picture, known = np.zeros((2, int(o.rows.max()) + 1, int(o.columns.max()) + 1))
    picture[o.rows, o.columns] = fit.residual
    known[o.rows, o.columns] = 1
    return picture, known.astype(bool)
