"""Stacks of pictures of one exposure: the mean picture with the sensor's fixed pattern, and its residual temporal
variance. EMVA 1288 release 4.0 linear, section 8.2."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import convolve1d, uniform_filter

from procedures.numerics.arrays import Array
from procedures.sensor.levels import Numbers
from procedures.sensor.rounding import NEGLIGIBLE

BOXES = (7, 11)
"""Sides of the box filters that, with a binomial of 3, separate slow variation of the light from the pattern."""
LEAST_PICTURES = 3
BINOMIAL = np.array([0.25, 0.5, 0.25])


@dataclass(frozen=True, eq=False)
class FrameStack:
    """A stack's mean picture.

    mean_picture : (rows, columns), in digital numbers
    variance : temporal variance of one picture, averaged over the pixels, without changes of the light
    row_variance, column_variance : temporal variance of the averages of a picture's rows, and of its columns
    count : number of pictures
    light_spread : standard deviation of the pictures' means over their mean
    exposure_s, light : as in `LightLevel`
    """

    mean_picture: Array
    variance: float
    row_variance: float
    column_variance: float
    count: int
    light_spread: float
    exposure_s: float
    light: float

    @property
    def mean(self) -> float:
        """Mean over all pixels."""
        return float(self.mean_picture.mean())

    @property
    def residual_variance(self) -> tuple[float, float, float]:
        """Temporal variance in the mean picture: of its pixels, its rows' averages, its columns'."""
        return self.variance / self.count, self.row_variance / self.count, self.column_variance / self.count


def least_spread(stack: FrameStack) -> float:
    """Least standard deviation of good pixels, DN: where rounding dominates, most pixels have one number."""
    return 0.5 if stack.variance < NEGLIGIBLE else 0.0


class StackSums:
    """Running sums over the pictures of a stack, which are not kept."""

    def __init__(self) -> None:
        self._zero: Array | None = None
        self._total = self._squares = np.zeros(())
        self._rows: list[Array] = []
        self._columns: list[Array] = []

    def add(self, picture: Numbers) -> None:
        """Add one picture (rows, columns) of digital numbers."""
        values = np.asarray(picture, dtype=np.float64)
        if self._zero is None:
            self._zero = values  # sums of differences from it keep all digits
            self._total, self._squares = np.zeros_like(values), np.zeros_like(values)
        values = values - self._zero
        self._total += values
        self._squares += values * values
        self._rows.append(values.mean(axis=1))
        self._columns.append(values.mean(axis=0))

    def stack(self, exposure_s: float, light: float) -> FrameStack:
        """Stack of the added pictures. Raises ValueError for fewer than three."""
        count = len(self._rows)
        if self._zero is None or count < LEAST_PICTURES:
            raise ValueError(f"a stack has {LEAST_PICTURES} pictures or more; got {count}")
        mean_picture = self._zero + self._total / count
        means = np.array([row.mean() for row in self._rows])
        shared = float(np.var(means, ddof=1))  # common to all pixels: a change of the light
        return FrameStack(
            mean_picture,
            float(np.mean(self._squares - self._total**2 / count)) / (count - 1) - shared,
            float(np.mean(np.var(self._rows, axis=0, ddof=1))) - shared,
            float(np.mean(np.var(self._columns, axis=0, ddof=1))) - shared,
            count,
            shared**0.5 / abs(float(mean_picture.mean()) or 1.0),
            exposure_s,
            light,
        )


def measure_stack(pictures: Iterable[Numbers], exposure_s: float, light: float) -> FrameStack:
    """Stack of three pictures or more. Raises ValueError for fewer."""
    sums = StackSums()
    for picture in pictures:
        sums.add(picture)
    return sums.stack(exposure_s, light)


def slow_part(picture: Array) -> Array:
    """Slow variation over a picture, mainly uneven light. Release 4.0 linear, section 8.1."""
    smooth = picture
    for side in BOXES:
        smooth = uniform_filter(smooth, side, mode="reflect")
    for axis in (0, 1):
        smooth = convolve1d(smooth, BINOMIAL, axis=axis, mode="reflect")
    return np.asarray(smooth)
