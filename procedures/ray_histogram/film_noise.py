"""Noise of a film's pixels: variance of their means, from the samples' variance or from the histograms."""

import numpy as np

from procedures.numerics.arrays import Array
from procedures.ray_histogram.film import BINS, EXPONENT, RANGE, Film


def mean_variance(film: Film) -> Array:
    """Variance of each pixel's mean, (rows, columns, 3), from the film's variance or else from its histograms.

    Infinite for a single sample. Histograms overestimate the variance slightly, as votes are divided between two nodes:
    the more, the wider the bins.
    """
    count = film.count.astype(np.float64)[..., None]
    variance = film.variance
    single = (_from_histograms(film, count) if variance is None else variance) / count
    return np.where(count > 1, single, np.inf)


def _from_histograms(film: Film, count: Array) -> Array:
    nodes = (RANGE * np.append(np.linspace(0, 1, BINS - 1), 2.0) ** EXPONENT).astype(np.float32)
    inside, most = film.histogram[..., :-1], film.histogram[..., -1]
    first, second = (np.asarray(inside @ nodes[:-1] ** k, np.float64) for k in (1, 2))
    # the last bin is unbounded: its mean brightness follows from the pixel's mean
    last = np.maximum((count * film.mean - first) / np.where(most > 0, most, 1.0), nodes[-2])
    first, second = first + most * last, second + most * last**2
    variance: Array = np.maximum(second - first**2 / count, 0.0) / np.maximum(count - 1.0, 1.0)
    return variance
