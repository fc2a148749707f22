"""A level of light from its pictures: the mean of the digital numbers, their temporal variance, and how well both are
known. EMVA 1288 release 4.0 linear, section 6.6: two pictures a level suffice, as their difference has no pattern."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.integer] | npt.NDArray[np.floating]

SEEN = 4.0
"""Standard errors from which on a correlation of the noise along rows or columns counts."""
STRAY = 1e-3
"""Share of the samples, dead pixels, that may lie below the lowest number."""
LEAST_NUMBERS = 4
"""Numbers that noise must be spread over to be seen cut off."""
LOOKED_AT = 500_000
"""Samples of a picture that are looked at for that."""


@dataclass(frozen=True)
class LightLevel:
    """What pairs of pictures of one exposure tell.

    Attributes
    ----------
    exposure_s : float
    light : float
        What the sensor was given: mean photons per pixel where they are known, else any number proportional to them;
        0 in the dark.
    mean, variance : float
        Of the digital numbers; the variance is temporal, the change of the light between the pictures taken out.
    mean_variance, variance_variance : float
        Squares of their standard uncertainties, noise that rows or columns share allowed for.
    change : float
        Mean of the later picture less the earlier, in digital numbers (root mean square of several pairs).
    change_variance : float
        What noise alone would make of its square.
    bottom : float
        Share of the samples that are piled up at their own lowest number.
    samples : int
        Samples of all pairs' differences.
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


def measure_level(pictures: Sequence[Numbers], exposure_s: float, light: float) -> LightLevel:
    """The level of an even number of pictures, taken two by two.

    Parameters
    ----------
    pictures : at least two (rows, columns) of digital numbers

    Raises
    ------
    ValueError
        If there are fewer than two.
    """
    if len(pictures) < 2:
        raise ValueError(f"temporal noise needs two pictures of a level; got {len(pictures)}")
    pairs = [_measure_pair(a, b) for a, b in zip(pictures[::2], pictures[1::2], strict=False)]
    mean, variance, mean_variance, variance_variance, change = (float(v) for v in np.mean(pairs, axis=0))
    return LightLevel(
        exposure_s,
        light,
        mean,
        variance,
        mean_variance / len(pairs),
        variance_variance / len(pairs),
        change**0.5,
        4 * mean_variance,  # of a difference of two pictures, each half of what the mean is of
        bottom_pile(pictures[0]),
        pictures[0].size * len(pairs),
    )


def _measure_pair(a: Numbers, b: Numbers) -> tuple[float, float, float, float, float]:
    """Mean, temporal variance, the variances of both, and the square of the change, from two pictures."""
    first, second = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
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
    """How many samples lie along an axis, and the correlation that all noise along it has; 0 where none is seen."""
    length, lines = difference.shape[axis], difference.shape[1 - axis]
    if variance <= 0 or min(length, lines) < 2:
        return length, 0.0
    ratio = float(np.var(difference.mean(axis=axis))) * length / variance  # 1 of independent noise
    seen = ratio - 1 > SEEN * np.sqrt(2 / lines)
    return length, (ratio - 1) / (length - 1) if seen else 0.0


def bottom_pile(picture: Numbers) -> float:
    """Share of the samples at the lowest number, where it was cut off there; 0 where the noise runs out by itself.

    Noise grows rarer towards its end: a last number that is no rarer than the one above it was cut off.
    """
    values, counts = np.unique(np.asarray(picture).ravel()[:: 1 + picture.size // LOOKED_AT], return_counts=True)
    share = counts / counts.sum()
    first = int(np.searchsorted(np.cumsum(share), STRAY))
    if len(values) < first + LEAST_NUMBERS or share[first] < share[first + 1]:
        return 0.0
    return float(share[: first + 1].sum())
