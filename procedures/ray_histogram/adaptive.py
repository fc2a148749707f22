"""Adaptive sampling: new samples where few similar pixels exist and the noise is large.

A renderer filters its film, casts the samples allotted to each pixel, and repeats this with the film of all samples.
"""

import numpy as np
from scipy import ndimage

from procedures.numerics.arrays import Array, Array32, Indices
from procedures.outcome import BadParameter
from procedures.ray_histogram.film import Film

SMOOTHING = 3  # side of the neighbourhood over which variances are averaged, as those of single pixels are noisy
FAINT = 1e-3
"""Smallest variance of a sample as a fraction of the picture's mean: an apparently noiseless pixel may not be."""


def allot(film: Film, similar: Array32, budget: int) -> Indices:
    """Number of samples to add to each pixel, (rows, columns), `budget` in all.

    A filtered pixel has the variance v / (n c): v that of one sample, n the pixel's count, c its similar patches. The
    sum over pixels is minimal for n proportional to sqrt(v / c); pixels above that get none.
    """
    if budget < 0:
        raise BadParameter(f"a budget is 0 samples or more; got {budget}", "give 0 or more")
    variance = film.variance
    v = np.ones(film.count.shape) if variance is None else variance.mean(-1)
    v = ndimage.uniform_filter(v, SMOOTHING)
    need = np.sqrt((v + FAINT * v.mean()) / similar) if v.any() else 1 / np.sqrt(similar)
    # the shares rounded to integers that sum to the budget: the largest remainders are rounded up
    shares = _fill(need, film.count.astype(np.float64), float(budget))
    whole = np.floor(shares).astype(np.int64)
    missing = budget - int(whole.sum())
    order = np.argsort(whole - shares, axis=None, kind="stable")
    whole.ravel()[order[: max(missing, 0)]] += 1
    return whole


def _fill(need: Array, level: Array, budget: float) -> Array:
    # pixels in the order of the x from which on they get samples, so that their sums are prefix sums
    order = np.argsort(level / need, axis=None)
    needs, levels = np.cumsum(need.ravel()[order]), np.cumsum(level.ravel()[order])
    begins = (level / need).ravel()[order]
    spent = begins * needs - levels
    last = int(np.searchsorted(spent, budget, side="right")) - 1
    x = (budget + levels[last]) / needs[last]
    shares: Array = np.maximum(0.0, x * need - level)
    return shares
