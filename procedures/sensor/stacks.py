"""Stacks of pictures of one exposure: the mean picture with the sensor's fixed pattern, and its residual temporal
variance. EMVA 1288 release 4.0 linear, section 8.2."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import convolve1d, uniform_filter

from procedures.corruption.noise import Variogram
from procedures.numerics.arrays import Array
from procedures.outcome import BadInput
from procedures.reading.arrays import Shape, checked_array
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
        """Add one picture (rows, columns) of digital numbers. Raises BadInput as `measure_level`."""
        values = _checked(picture, (None, None) if self._zero is None else self._zero.shape)
        if self._zero is None:
            self._zero = values  # sums of differences from it keep all digits
            self._total, self._squares = np.zeros_like(values), np.zeros_like(values)
        values = values - self._zero
        self._total += values
        self._squares += values * values
        self._rows.append(values.mean(axis=1))
        self._columns.append(values.mean(axis=0))

    def stack(self, exposure_s: float, light: float) -> FrameStack:
        """Stack of the added pictures. Raises BadInput for fewer than three."""
        count = len(self._rows)
        if self._zero is None or count < LEAST_PICTURES:
            raise BadInput(f"a stack has {LEAST_PICTURES} pictures or more; got {count}", "take further ones")
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
    """Stack of three pictures or more. Raises BadInput for fewer, and as `measure_level`."""
    sums = StackSums()
    for picture in pictures:
        sums.add(picture)
    return sums.stack(exposure_s, light)


def _checked(picture: Numbers, shape: Shape) -> Array:
    remedy = "give whole pictures of one plane, in digital numbers"
    return np.asarray(checked_array(picture, "a picture", shape, remedy=remedy))


def slow_part(picture: Array) -> Array:
    """Slow variation over a picture, mainly uneven light. Release 4.0 linear, section 8.1."""
    smooth = picture
    for side in BOXES:
        smooth = uniform_filter(smooth, side, mode="reflect")
    for axis in (0, 1):
        smooth = convolve1d(smooth, BINOMIAL, axis=axis, mode="reflect")
    return np.asarray(smooth)


# --- Recording of a sensor: dark and bright levels, a dark and a flat stack ---


@dataclass(frozen=True, eq=False)
class SensorRecording:
    """One plane's levels and stacks, in digital numbers.

    darks : without light; lights : with light; in any order, kept by exposure time and by light
    photons_known : whether `light` is photons per pixel
    """

    darks: tuple[LightLevel, ...]
    lights: tuple[LightLevel, ...]
    photons_known: bool
    dark_stack: FrameStack | None
    flat_stack: FrameStack | None

    def __post_init__(self) -> None:
        object.__setattr__(self, "darks", tuple(sorted(self.darks, key=lambda one: one.exposure_s)))
        object.__setattr__(self, "lights", tuple(sorted(self.lights, key=lambda one: one.light)))

    @property
    def dark_weights(self) -> Array:
        """Weights (bright, dark) that interpolate the dark levels linearly to each bright level's exposure."""
        known = np.array([level.exposure_s for level in self.darks])
        wanted = np.array([level.exposure_s for level in self.lights])
        return np.column_stack([np.interp(wanted, known, row) for row in np.eye(len(known))])

    @property
    def signal(self) -> Array:
        """Mean of each bright level less the dark at its exposure."""
        return column(light.mean for light in self.lights) - self.dark_weights @ column(one.mean for one in self.darks)


def column(values: Iterable[float]) -> Array:
    """One attribute of all levels, as an array."""
    return np.fromiter(values, dtype=np.float64)


# --- A level of light from its pictures: mean of the digital numbers, temporal variance, and their uncertainties ---
# EMVA 1288 release 4.0 linear, section 6.6: two pictures per level suffice, as their difference has no fixed pattern.

Numbers = npt.NDArray[np.integer] | npt.NDArray[np.floating]

SIGNIFICANT = 4.0  # standard errors from which a correlation of the noise along rows or columns is significant
STRAY = 1e-3  # accepted share of samples below the lowest number: dead pixels
LEAST_NUMBERS = 4  # different numbers of the noise required to detect clipping
SEARCHED = 500_000  # samples of a picture searched for clipping
JUDGED_PX = 256  # side of a picture's middle of which neighbouring pixels' noise is compared


@dataclass(frozen=True)
class LightLevel:
    """Statistics of pairs of pictures of one exposure.

    light : mean photons per pixel where known, otherwise a number proportional to them; 0 in the dark
    mean, variance : of the digital numbers; the variance is temporal, without the change of the light between the
        pictures
    mean_variance, variance_variance : squares of their standard uncertainties, including noise common to rows or
        columns
    change : mean of the later picture less the earlier, in digital numbers (root mean square of several pairs)
    change_variance : expected square of `change` by noise alone
    bottom : share of the samples clipped at the lowest number
    samples : samples of all pairs' differences
    noise : variogram of the first pair's difference in the middle of the picture
    """

    exposure_s: float
    light: float
    mean: float
    variance: float
    mean_variance: float
    variance_variance: float
    change: float
    change_variance: float
    bottom: float
    samples: int
    noise: Variogram


def measure_level(pictures: Sequence[Numbers], exposure_s: float, light: float) -> LightLevel:
    """The level of an even number of pictures, taken two by two.

    pictures : at least two (rows, columns) of digital numbers

    Raises BadInput if there are fewer than two, they differ in size, or are not finite.
    """
    if len(pictures) < 2:
        raise BadInput(f"temporal noise needs two pictures of a level; got {len(pictures)}", "take further ones")
    first = _checked(pictures[0], (None, None))
    checked = [first, *(_checked(one, first.shape) for one in pictures[1:])]
    pairs = [_measure_pair(a, b) for a, b in zip(checked[::2], checked[1::2], strict=False)]
    mean, variance, mean_variance, variance_variance, change = (float(v) for v in np.mean(pairs, axis=0))
    return LightLevel(
        exposure_s,
        light,
        mean,
        variance,
        mean_variance / len(pairs),
        variance_variance / len(pairs),
        change**0.5,
        4 * mean_variance,  # difference of two pictures, where the mean has both
        bottom_pile(first),
        first.size * len(pairs),
        _noise(first, checked[1]),
    )


def _noise(a: Array, b: Array) -> Variogram:
    """Noise of two pictures around the middle, without that common to rows or columns."""
    middle = tuple(slice((n - min(n, JUDGED_PX)) // 2, (n + min(n, JUDGED_PX)) // 2) for n in a.shape)
    difference = a[middle] - b[middle]
    for axis in (0, 1):
        difference -= difference.mean(axis=axis, keepdims=True)
    return Variogram.of(difference, np.ones(difference.shape, dtype=bool))


def _measure_pair(first: Array, second: Array) -> tuple[float, float, float, float, float]:
    """Mean, temporal variance, the variances of both, and the square of the change, from two pictures."""
    difference = second - first
    change = float(difference.mean())
    difference -= change
    n = difference.size
    variance = float(np.vdot(difference, difference)) / (2 * (n - 1))
    along = [_shared(difference, axis, 2 * variance) for axis in (0, 1)]
    of_mean = 1 + sum(length * r for length, r in along)
    of_variance = 1 + sum(length * r * r for length, r in along)
    mean = float(first.mean() + second.mean()) / 2
    return mean, variance, variance / (2 * n) * of_mean, 2 * variance**2 / (n - 1) * of_variance, change**2


def _shared(difference: Array, axis: int, variance: float) -> tuple[int, float]:
    """Number of samples along an axis, and the correlation of the noise along it; 0 where not significant."""
    length, lines = difference.shape[axis], difference.shape[1 - axis]
    if variance <= 0 or min(length, lines) < 2:
        return length, 0.0
    ratio = float(np.var(difference.mean(axis=axis))) * length / variance  # 1 of independent noise
    significant = ratio - 1 > SIGNIFICANT * np.sqrt(2 / lines)
    return length, (ratio - 1) / (length - 1) if significant else 0.0


def bottom_pile(picture: Numbers) -> float:
    """Share of the samples clipped at the lowest number: noise becomes rarer towards its end, so a last number at least
    as frequent as the next was clipped."""
    values, counts = np.unique(np.asarray(picture).ravel()[:: 1 + picture.size // SEARCHED], return_counts=True)
    share = counts / counts.sum()
    first = int(np.searchsorted(np.cumsum(share), STRAY))
    if len(values) < first + LEAST_NUMBERS or share[first] < share[first + 1]:
        return 0.0
    return float(share[: first + 1].sum())
