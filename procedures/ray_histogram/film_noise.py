"""How noisy a film's pixels are: the variance of their means, from its samples' or read off its histograms."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from procedures.ray_histogram.film import BINS, EXPONENT, RANGE, Film

Doubles = npt.NDArray[np.float64]


def mean_variance(film: Film) -> Doubles:
    """Variance of each pixel's mean, (rows, columns, 3): the film's, or read off its histograms where it kept none.

    Infinite where there is a single sample. Votes between two nodes tell a little more variance than there was, the
    wider the bins the more.
    """
    count = film.count.astype(np.float64)[..., None]
    variance = film.variance
    found = (_read_off(film, count) if variance is None else variance) / count
    return np.where(count > 1, found, np.inf)


def _read_off(film: Film, count: Doubles) -> Doubles:
    nodes = (RANGE * np.append(np.linspace(0, 1, BINS - 1), 2.0) ** EXPONENT).astype(np.float32)
    inside, most = film.histogram[..., :-1], film.histogram[..., -1]
    first, second = (np.asarray(inside @ nodes[:-1] ** k, np.float64) for k in (1, 2))
    # the last bin is wide and without an end: the mean tells how bright what fell into it was
    last = np.maximum((count * film.mean - first) / np.where(most > 0, most, 1.0), nodes[-2])
    first, second = first + most * last, second + most * last**2
    variance: Doubles = np.maximum(second - first**2 / count, 0.0) / np.maximum(count - 1.0, 1.0)
    return variance
