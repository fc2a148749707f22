"""Stacks of pictures of one exposure: the mean picture, in which only the sensor's own pattern is left, and the
temporal variance that is still in it. EMVA 1288 release 4.0 linear, section 8.2."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import convolve1d, uniform_filter

from procedures.sensor.levels import Numbers

Array = npt.NDArray[np.float64]

BOXES = (7, 11)
"""Sides of the box filters that, with a binomial of 3, tell slow changes of the light from the sensor's pattern."""
LEAST_PICTURES = 3
BINOMIAL = np.array([0.25, 0.5, 0.25])


@dataclass(frozen=True, eq=False)
class FrameStack:
    """A stack's mean picture.

    Attributes
    ----------
    mean_picture : (rows, columns) float64
        In digital numbers.
    variance : float
        Temporal variance of one picture, averaged over the pixels; the changes of the light are taken out.
    row_variance, column_variance : float
        Temporal variance of the averages of a picture's rows, and of its columns.
    count : int
        Pictures.
    light_spread : float
        Standard deviation of the pictures' means over their mean.
    exposure_s, light : float
        As of a level.
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
        """Of all pixels."""
        return float(self.mean_picture.mean())

    @property
    def left_over(self) -> tuple[float, float, float]:
        """Temporal variance that is left in the mean picture: of its pixels, its rows' averages, its columns'."""
        return self.variance / self.count, self.row_variance / self.count, self.column_variance / self.count


class StackSums:
    """Sums over the pictures of a stack, which come one after the other and are not kept."""

    def __init__(self) -> None:
        self._zero: Array | None = None
        self._total = self._squares = np.zeros(())
        self._rows: list[Array] = []
        self._columns: list[Array] = []

    def add(self, picture: Numbers) -> None:
        """Count one picture (rows, columns) of digital numbers in."""
        values = np.asarray(picture, dtype=np.float64)
        if self._zero is None:
            self._zero = values  # sums are of differences from it: no digits are lost
            self._total, self._squares = np.zeros_like(values), np.zeros_like(values)
        values = values - self._zero
        self._total += values
        self._squares += values * values
        self._rows.append(values.mean(axis=1))
        self._columns.append(values.mean(axis=0))

    def stack(self, exposure_s: float, light: float) -> FrameStack:
        """The stack of what came. Raises ValueError if that is fewer than three pictures."""
        count = len(self._rows)
        if self._zero is None or count < LEAST_PICTURES:
            raise ValueError(f"a stack has {LEAST_PICTURES} pictures or more; got {count}")
        mean_picture = self._zero + self._total / count
        means = np.array([row.mean() for row in self._rows])
        shared = float(np.var(means, ddof=1))  # what all pixels have in common is a change of the light
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
    """The stack of three pictures or more. Raises ValueError if there are fewer."""
    sums = StackSums()
    for picture in pictures:
        sums.add(picture)
    return sums.stack(exposure_s, light)


def slow_part(picture: Array) -> Array:
    """What changes slowly over a picture: uneven light more than the sensor. Release 4.0 linear, section 8.1."""
    smooth = picture
    for side in BOXES:
        smooth = uniform_filter(smooth, side, mode="reflect")
    for axis in (0, 1):
        smooth = convolve1d(smooth, BINOMIAL, axis=axis, mode="reflect")
    return np.asarray(smooth)
