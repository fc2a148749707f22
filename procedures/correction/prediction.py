"""What a correction gains and costs, told from its linear part: MTF50 before and after, and the gain of the noise.

Where differences have the length g, a penalty tau |D u| acts as (tau / g) |D u|^2 / 2 does, and the picture is a filter
of the samples: R = w H* / (w |H|^2 + tau / g |D|^2). H R is the transfer function after, the mean square of R the
noise's gain. Edges are long differences, flat parts usual ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from procedures.correction.optics import Optics
from procedures.correction.priors import Prior

Array = npt.NDArray[np.float64]

PLACES = (7, 9)
"""Rows and columns of the map."""
EDGES = 10.0
"""Differences of edges over the mean one."""
SIDE = 128
"""Samples of the frequencies' grid."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """Maps over the frame, of the plane that shows lightness: green, or grey.

    Attributes
    ----------
    x : (m,), y : (n,) float64
        Places, in pixels of the picture.
    before, after : (n, m) float64
        MTF50 in cycles per pixel of the picture, mean over directions; 0.5 where it is beyond what the grid shows.
    noise_gain : (n, m) float64
        Standard deviation of the picture's noise where the scene is flat, over that of a sample.
    """

    x: Array
    y: Array
    before: Array
    after: Array
    noise_gain: Array

    @property
    def gain(self) -> Array:
        """MTF50 after over before."""
        return np.asarray(self.after / self.before)


class Measured(Protocol):
    """What is told of the samples."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the picture."""
        ...

    @property
    def channel(self) -> Sequence[int]:
        """Colours of the planes."""
        ...

    @property
    def channels(self) -> int:
        """How many colours."""
        ...


def predict(optics: Optics, mosaic: Measured, prior: Prior, tau: float, difference: float) -> Prediction:
    """The maps, for a prior of strength `tau` and a picture whose mean difference is so large."""
    rows, columns = mosaic.shape
    y, x = np.linspace(0, rows - 1, PLACES[0]), np.linspace(0, columns - 1, PLACES[1])
    shown = 1 if mosaic.channels > 1 else 0
    own = [p for p, colour in enumerate(optics.channel) if colour == shown]
    density = len(own) / optics.pitch**2
    power = prior.power(SIDE)
    maps = np.empty((3, len(y), len(x)))
    for i, j in np.ndindex(maps.shape[1:]):
        H = np.abs(optics.otf(float(x[j]), float(y[i]), SIDE)[own]).mean(axis=0).astype(np.float64)
        edges = density * H / (density * H**2 + tau / (EDGES * difference) * power)
        flat = density * H / (density * H**2 + tau / difference * power)
        # a real picture's half plane: all but the first and the last column stand for two frequencies
        counted = np.full(H.shape, 2.0)
        counted[:, [0, -1]] = 1
        maps[:, i, j] = _half(H), _half(H * edges), np.sqrt(np.sum(counted * flat**2) / SIDE**2 / density)
    return Prediction(x, y, *maps)


def _half(transfer: Array) -> float:
    """Where the mean over directions first falls below one half, in cycles per sample; 0.5 if nowhere."""
    f = np.hypot(np.fft.fftfreq(SIDE)[:, None], np.arange(SIDE // 2 + 1) / SIDE)
    rings = np.rint(f * SIDE).astype(int)
    inside = rings <= SIDE // 2
    mean = np.bincount(rings[inside], transfer[inside]) / np.bincount(rings[inside])
    low = np.flatnonzero(mean < 0.5)
    if len(low) == 0 or low[0] == 0:
        return 0.5
    i = int(low[0])
    return float(np.interp(0.5, mean[[i, i - 1]], np.array([i, i - 1]) / SIDE))
