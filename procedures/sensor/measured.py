"""Numbers with a 95 % interval, from draws or from a variance."""

from dataclasses import dataclass, replace

import numpy as np

from procedures.numerics.arrays import Array
from procedures.outcome import Quantity

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
