"""Defect pixels: too bright in the dark, or too bright or too dark in even light.

EMVA 1288 release 4.0 linear, section 8.5, leaves the limit to the application and requires logarithmic histograms;
here a pixel is a defect beyond a deviation that a normal distribution is not expected to reach in all pixels.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr, ndtri

from procedures.numerics.arrays import Array, Mask
from procedures.sensor.measured import IntervalNumber
from procedures.sensor.stacks import FrameStack, slow_part

EXPECTED = 0.01  # expected false positives of a sensor without defects
MAD = 1.4826  # standard deviation over median absolute deviation, of a normal distribution
BINS = 256


@dataclass(frozen=True, eq=False)
class Histogram:
    """Histogram of the pixels' deviations from the mean.

    centres : (n,), deviations: in digital numbers, or per cent of the signal
    counts : (n,) int64
    model : (n,), counts of a normal distribution of the same robust deviation
    limit : deviation above which a pixel is a defect
    """

    centres: Array
    counts: npt.NDArray[np.int64]
    model: Array
    limit: float


@dataclass(frozen=True, eq=False)
class Defects:
    """Defect pixels of a mean picture.

    places : (n, 2) intp; [row, column], the largest deviation first
    deviation : (n,) float64
    count : with an interval: pixels near the limit may be on either side, within their noise
    """

    places: npt.NDArray[np.intp]
    deviation: Array
    count: IntervalNumber
    histogram: Histogram

    def mask(self, shape: tuple[int, ...]) -> Mask:
        """Mask of the defects in a picture of that shape."""
        mask = np.zeros(shape, dtype=np.bool_)
        mask[tuple(self.places.T)] = True
        return mask


def find_defects(field: Array, noise: float, scale: float = 1.0, least_spread: float = 0.0) -> Defects:
    """Pixels of a picture of deviations (rows, columns) that are too far from 0.

    noise : standard deviation of the temporal noise in the picture
    scale : from the picture's unit to that of the result
    least_spread : least standard deviation that is attributed to good pixels, in the picture's unit
    """
    spread = max(MAD * float(np.median(np.abs(field))), least_spread)
    limit = -float(ndtri(EXPECTED / field.size / 2)) * max(spread, 1e-12)
    far = np.abs(field) > limit
    places = np.argwhere(far)
    order = np.argsort(-np.abs(field[far]), kind="stable")
    count = _count(np.abs(field), limit, noise)
    return Defects(places[order], field[far][order] * scale, count, _histogram(field, spread, limit, scale))


def _count(size: Array, limit: float, noise: float) -> IntervalNumber:
    """Number of deviations above the limit, with the numbers of certain and possible ones."""
    low, value, high = (int(np.sum(size > limit + k * noise)) for k in (2, 0, -2))
    method = "deviation from the neighbourhood beyond what a normal distribution has once"
    # the lower limit includes the flank of the good pixels, whose number is known
    share = (limit - 2 * noise) / max(limit, 1e-12)
    expected = size.size * 2 * float(ndtr(share * ndtri(EXPECTED / size.size / 2)))
    high = max(value, round(high - expected))
    return IntervalNumber(value, "pixels", (high - low) / 4, method, size.size, low, high)


def _histogram(field: Array, spread: float, limit: float, scale: float) -> Histogram:
    low, high = float(field.min()), float(field.max())
    counts, edges = np.histogram(field, BINS, (low, max(high, low + 1e-9)))
    centres = (edges[:-1] + edges[1:]) / 2
    width = edges[1] - edges[0]
    deviation = max(spread, 1e-12)
    model = field.size * width / (np.sqrt(2 * np.pi) * deviation) * np.exp(-((centres / deviation) ** 2) / 2)
    return Histogram(centres * scale, counts.astype(np.int64), model, limit * scale)


def dark_field(stack: FrameStack) -> Array:
    """Deviations in the dark from each pixel's row, column and surroundings."""
    return _high_passed(stack.mean_picture)


def response_field(dark: FrameStack, flat: FrameStack) -> Array:
    """Deviations of the response in even light without the dark, in digital numbers."""
    return _high_passed(flat.mean_picture - dark.mean_picture)


def _high_passed(picture: Array) -> Array:
    """The picture without slow variation of rows and columns; outliers are clipped first."""
    field = picture - np.median(picture, axis=1)[:, None]
    field = field - np.median(field, axis=0)[None, :]
    spread = MAD * float(np.median(np.abs(field)))
    return np.asarray(field - slow_part(np.clip(field, -3 * spread, 3 * spread)))
