"""Numbers with a 95 % interval, from draws of what they are computed from, or from a variance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.outcome import Quantity

Array = npt.NDArray[np.float64]

CONFIDENT = 1.96
"""Standard uncertainties on either side that hold 95 % of a normal distribution."""


@dataclass(frozen=True)
class IntervalNumber(Quantity):
    """A number with the 95 % interval in which the true one lies."""

    low: float
    high: float


def measured(
    value: float, uncertainty: float, unit: str, method: str, n: int, *, least: float = -np.inf, lower: float = 0.0
) -> IntervalNumber:
    """A number whose error is normal.

    Parameters
    ----------
    least : float
        What the number cannot be below: the interval ends there.
    lower : float
        By how much noise alone may have raised the value: the interval reaches down by so much more.
    """
    low, high = value - CONFIDENT * uncertainty - lower, value + CONFIDENT * uncertainty
    return IntervalNumber(value, unit, uncertainty, method, n, max(low, least), max(high, least))


def from_draws(values: Array, unit: str, method: str, n: int, *, beside: float = 0.0) -> IntervalNumber:
    """The first value, with the spread of the others, which are what it might as well have been.

    Parameters
    ----------
    values : (1 + draws,) float64
    beside : float
        A standard uncertainty that the draws do not hold.
    """
    uncertainty = float(np.hypot(np.std(values[1:]), beside))
    return measured(float(values[0]), uncertainty, unit, method, n)


def root(variance: float, uncertainty: float, scale: float, unit: str, method: str, n: int) -> IntervalNumber:
    """The square root of a variance, times a scale; 0 where noise left the variance negative.

    The interval is that of the variance, through the root: it ends at 0 where the variance may be none.
    """
    low, high = variance - CONFIDENT * uncertainty, max(variance + CONFIDENT * uncertainty, uncertainty)
    ends = np.sqrt(np.maximum([variance, low, high], 0)) * scale
    value = float(ends[0])
    spread = uncertainty * scale / (2 * np.sqrt(variance)) if variance > uncertainty else np.sqrt(uncertainty) * scale
    return IntervalNumber(value, unit, float(spread), method, n, float(ends[1]), float(ends[2]))


def with_share(number: IntervalNumber, share: float) -> IntervalNumber:
    """The number with a further relative standard uncertainty, such as that of what it was divided by."""
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
