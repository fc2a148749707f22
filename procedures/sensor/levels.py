"""A level of light from its pictures: mean of the digital numbers, temporal variance, and their uncertainties.

EMVA 1288 release 4.0 linear, section 6.6: two pictures per level suffice, as their difference has no fixed pattern.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.numerics.arrays import Array

Numbers = npt.NDArray[np.integer] | npt.NDArray[np.floating]

SIGNIFICANT = 4.0  # standard errors from which a correlation of the noise along rows or columns is significant
STRAY = 1e-3  # accepted share of samples below the lowest number: dead pixels
LEAST_NUMBERS = 4  # different numbers of the noise required to detect clipping
SEARCHED = 500_000  # samples of a picture searched for clipping


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
        4 * mean_variance,  # difference of two pictures, where the mean has both
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
    """Number of samples along an axis, and the correlation of the noise along it; 0 where not significant."""
    length, lines = difference.shape[axis], difference.shape[1 - axis]
    if variance <= 0 or min(length, lines) < 2:
        return length, 0.0
    ratio = float(np.var(difference.mean(axis=axis))) * length / variance  # 1 of independent noise
    significant = ratio - 1 > SIGNIFICANT * np.sqrt(2 / lines)
    return length, (ratio - 1) / (length - 1) if significant else 0.0


def bottom_pile(picture: Numbers) -> float:
    """Share of the samples clipped at the lowest number; 0 without clipping.

    The density of noise decreases towards its end: a last number at least as frequent as the next was clipped.
    """
    values, counts = np.unique(np.asarray(picture).ravel()[:: 1 + picture.size // SEARCHED], return_counts=True)
    share = counts / counts.sum()
    first = int(np.searchsorted(np.cumsum(share), STRAY))
    if len(values) < first + LEAST_NUMBERS or share[first] < share[first + 1]:
        return 0.0
    return float(share[: first + 1].sum())
