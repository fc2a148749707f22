"""Pixels that do not belong to the others: in the dark too bright, or in even light too bright or too dark.

EMVA 1288 release 4.0 linear, section 8.5, leaves the limit to the application and asks for logarithmic histograms;
here a pixel is a defect where so large a deviation is not expected once in all pixels of a normal distribution.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import ndtri

from procedures.sensor.measured import IntervalNumber
from procedures.sensor.stacks import FrameStack, slow_part

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

EXPECTED = 0.01
"""Pixels of a sensor without defects that are named all the same."""
MAD = 1.4826
"""Standard deviation over median absolute deviation, of a normal distribution."""
BINS = 256


@dataclass(frozen=True, eq=False)
class Histogram:
    """How many pixels deviate how far from the mean, and how many do so at least.

    Attributes
    ----------
    centres : (n,) float64
        Deviations: in digital numbers, or per cent of the signal.
    counts : (n,) int64
    model : (n,) float64
        Counts of a normal distribution of the same robust deviation.
    limit : float
        Deviation from which on a pixel is a defect.
    """

    centres: Array
    counts: npt.NDArray[np.int64]
    model: Array
    limit: float


@dataclass(frozen=True, eq=False)
class Defects:
    """The deviating pixels of a mean picture.

    Attributes
    ----------
    places : (n, 2) intp
        [row, column], the largest deviation first.
    deviation : (n,) float64
    count : IntervalNumber
        With an interval: pixels near the limit may lie on either side, within their own noise.
    histogram : Histogram
    """

    places: npt.NDArray[np.intp]
    deviation: Array
    count: IntervalNumber
    histogram: Histogram


def find_defects(field: Array, noise: float, scale: float = 1.0) -> Defects:
    """The pixels of a picture of deviations (rows, columns) that lie too far from 0.

    Parameters
    ----------
    noise : float
        Standard deviation of the temporal noise in the picture.
    scale : float
        From the picture's unit to that of the answer.
    """
    spread = MAD * float(np.median(np.abs(field)))
    limit = -float(ndtri(EXPECTED / field.size / 2)) * max(spread, 1e-12)
    far = np.abs(field) > limit
    places = np.argwhere(far)
    order = np.argsort(-np.abs(field[far]), kind="stable")
    count = _count(np.abs(field), limit, noise)
    return Defects(places[order], field[far][order] * scale, count, _histogram(field, spread, limit, scale))


def _count(size: Array, limit: float, noise: float) -> IntervalNumber:
    """The number over the limit, between those that are surely and those that are possibly."""
    low, value, high = (int(np.sum(size > limit + k * noise)) for k in (2, 0, -2))
    method = "deviation from the neighbourhood beyond what a normal distribution has once"
    # at the inner limit the flank of the good pixels comes in: these are known to be none
    expected = size.size * 2 * float(_beyond((limit - 2 * noise) / max(limit, 1e-12), size.size))
    high = max(value, round(high - expected))
    return IntervalNumber(value, "pixels", (high - low) / 4, method, size.size, low, high)


def _beyond(share: float, n: int) -> float:
    """Probability of a normal deviation beyond a share of the limit on one side."""
    from scipy.special import ndtr

    return float(ndtr(share * ndtri(EXPECTED / n / 2)))


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
    """Deviations of the response in even light, in digital numbers, what is in the dark taken off."""
    return _high_passed(flat.mean_picture - dark.mean_picture)


def _high_passed(picture: Array) -> Array:
    """The picture without what changes slowly and without rows and columns, which are no defects of pixels.

    Medians first: one hot pixel must not pull its neighbours to the other side.
    """
    field = picture - np.median(picture, axis=1)[:, None]
    field = field - np.median(field, axis=0)[None, :]
    spread = MAD * float(np.median(np.abs(field)))
    tame = np.clip(field, -3 * spread, 3 * spread)
    return np.asarray(field - slow_part(tame))
