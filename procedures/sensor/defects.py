"""Defect pixels: too bright in the dark, or too bright or too dark in even light.

EMVA 1288 release 4.0 linear, section 8.5, leaves the limit to the application and requires logarithmic histograms;
here a pixel is a defect beyond a deviation that a normal distribution is not expected to reach in all pixels.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr, ndtri

from procedures.numerics.arrays import Array, Indices, Mask
from procedures.outcome import Quantity
from procedures.sensor.stacks import FrameStack, slow_part

EXPECTED = 0.01  # expected false positives of a sensor without defects
MAD = 1.4826  # standard deviation over median absolute deviation, of a normal distribution
BINS = 256

# --- Numbers with a 95 % interval, from draws or from a variance ---

CONFIDENT = 1.96  # half width of the 95 % interval of a normal distribution, in standard uncertainties


@dataclass(frozen=True)
class IntervalNumber(Quantity):
    """A number with its 95 % interval."""

    low: float
    high: float


def measured(
    value: float, uncertainty: float, unit: str, method: str, n: int, *, least: float = -np.inf, lower: float = 0.0
) -> IntervalNumber:
    """A number with a normal error; least : lower bound of it and its interval; lower : possible bias by noise, which
    extends the interval downwards."""
    low, high = value - CONFIDENT * uncertainty - lower, value + CONFIDENT * uncertainty
    return IntervalNumber(value, unit, uncertainty, method, n, max(low, least), max(high, least))


def positive(number: IntervalNumber) -> IntervalNumber:
    """The number of a positive quantity: an interval that would reach below 0 has the lower end of a log-normal one."""
    if number.low > 0 or number.value <= 0:
        return replace(number, low=max(number.low, 0.0))
    return replace(number, low=number.value * float(np.exp(-CONFIDENT * number.uncertainty / number.value)))


def from_draws(
    values: Array, unit: str, method: str, n: int, *, extra: float = 0.0, signed: bool = False
) -> IntervalNumber:
    """The first value, with the spread of the others.

    values : (1 + draws,) float64
    extra : further standard uncertainty, not included in the draws
    signed : whether the quantity may be negative
    """
    uncertainty = float(np.hypot(np.std(values[1:]), extra))
    number = measured(float(values[0]), uncertainty, unit, method, n)
    return number if signed else positive(number)


def bounded(number: IntervalNumber) -> IntervalNumber:
    """The number, which is not negative; where its interval reaches 0 only the upper end is known, and it says so."""
    if number.low > 0:
        return number
    return replace(number, method=f"{number.method}; only its upper bound is known", low=0.0)


def root(variance: float, uncertainty: float, scale: float, unit: str, method: str, n: int) -> IntervalNumber:
    """The square root of a variance, times a scale; 0 for a negative variance, and the root of its interval."""
    low, high = variance - CONFIDENT * uncertainty, max(variance + CONFIDENT * uncertainty, uncertainty)
    ends = np.sqrt(np.maximum([variance, low, high], 0)) * scale
    value = float(ends[0])
    spread = uncertainty * scale / (2 * np.sqrt(variance)) if variance > uncertainty else np.sqrt(uncertainty) * scale
    return bounded(IntervalNumber(value, unit, float(spread), method, n, float(ends[1]), float(ends[2])))


def with_share(number: IntervalNumber, share: float) -> IntervalNumber:
    """The number with a further relative standard uncertainty, such as that of a divisor."""
    if not number.value or not share:
        return number
    more = share * number.value
    below, above = number.value - number.low, number.high - number.value
    return IntervalNumber(
        number.value,
        number.unit,
        float(np.hypot(number.uncertainty, more)),
        number.method,
        number.n,
        max(0.0, number.value - float(np.hypot(below, CONFIDENT * more))),
        number.value + float(np.hypot(above, CONFIDENT * more)),
    )


# --- Defects ---


@dataclass(frozen=True, eq=False)
class Histogram:
    """Histogram of the pixels' deviations from the mean.

    centres : (n,), deviations: in digital numbers, or per cent of the signal
    counts : (n,) int64
    model : (n,), counts of a normal distribution of the same robust deviation
    limit : deviation above which a pixel is a defect
    """

    centres: Array
    counts: Indices
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
    # number of deviations above the limit, with the numbers of certain and possible ones
    size = np.abs(field)
    low, value, high = (int(np.sum(size > limit + k * noise)) for k in (2, 0, -2))
    method = "deviation from the neighbourhood beyond what a normal distribution has once"
    # the lower limit includes the flank of the good pixels, whose number is known
    share = (limit - 2 * noise) / max(limit, 1e-12)
    expected = size.size * 2 * float(ndtr(share * ndtri(EXPECTED / size.size / 2)))
    high = max(value, round(high - expected))
    count = IntervalNumber(value, "pixels", (high - low) / 4, method, size.size, low, high)
    return Defects(places[order], field[far][order] * scale, count, _histogram(field, spread, limit, scale))


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
