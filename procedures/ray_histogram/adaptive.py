"""Adaptive sampling: new samples go where the filter found few pixels to share with, and the light is noisy.

Who renders filters a film, casts what each pixel is allotted, and does so again with the film of all samples.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from procedures.outcome import BadParameter
from procedures.ray_histogram.film import Film

Doubles = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

SMOOTHING = 3
"""Side of the neighbourhood over which variances are averaged: those of single pixels are noisy themselves."""
FAINT = 1e-3
"""Least variance of a sample, as a share of the picture's mean variance: a pixel that looked noiseless may not be."""


def allot(film: Film, similar: npt.NDArray[np.float32], budget: int) -> Ints:
    """Samples to add to each pixel, (rows, columns), `budget` in all.

    A filtered pixel has a variance of v / (n c): v that of one sample, n the pixel's count, c its similar patches. The
    sum over pixels is least where n is in proportion to sqrt(v / c); pixels that have more already get none.
    """
    if budget < 0:
        raise BadParameter(f"a budget of {budget} samples", "give 0 or more")
    variance = film.variance
    v = np.ones(film.count.shape) if variance is None else variance.mean(-1)
    v = ndimage.uniform_filter(v, SMOOTHING)
    need = np.sqrt((v + FAINT * v.mean()) / similar) if v.any() else 1 / np.sqrt(similar)
    return _whole_shares(_fill(need, film.count.astype(np.float64), float(budget)), budget)


def _fill(need: Doubles, level: Doubles, budget: float) -> Doubles:
    """max(0, x need - level) for the x at which it sums to the budget."""
    # pixels by the x from which on they get samples; sums over those that do are sums over a prefix
    order = np.argsort(level / need, axis=None)
    needs, levels = np.cumsum(need.ravel()[order]), np.cumsum(level.ravel()[order])
    begins = (level / need).ravel()[order]
    spent = begins * needs - levels
    last = int(np.searchsorted(spent, budget, side="right")) - 1
    x = (budget + levels[last]) / needs[last]
    shares: Doubles = np.maximum(0.0, x * need - level)
    return shares


def _whole_shares(shares: Doubles, budget: int) -> Ints:
    """The shares rounded to whole numbers that sum to the budget: the largest remainders get one more."""
    whole = np.floor(shares).astype(np.int64)
    missing = budget - int(whole.sum())
    order = np.argsort(whole - shares, axis=None, kind="stable")
    whole.ravel()[order[: max(missing, 0)]] += 1
    return whole
