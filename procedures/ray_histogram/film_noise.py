"""Noise of a film's pixels: variance of their means, from the samples' variance or from the histograms."""

import numpy as np
import numpy.typing as npt

from procedures.ray_histogram.film import BINS, EXPONENT, RANGE, Film

Doubles = npt.NDArray[np.float64]


def mean_variance(film: Film) -> Doubles:
    """Variance of each pixel's mean, (rows, columns, 3), from the film's variance or else from its histograms.

    Infinite for a single sample. Histograms overestimate the variance slightly, as votes are divided between two nodes:
    the more, the wider the bins.
    """
    count = film.count.astype(np.float64)[..., None]
    variance = film.variance
    single = (_from_histograms(film, count) if variance is None else variance) / count
    return np.where(count > 1, single, np.inf)


def _from_histograms(film: Film, count: Doubles) -> Doubles:
    nodes = (RANGE * np.append(np.linspace(0, 1, BINS - 1), 2.0) ** EXPONENT).astype(np.float32)
    inside, most = film.histogram[..., :-1], film.histogram[..., -1]
    first, second = (np.asarray(inside @ nodes[:-1] ** k, np.float64) for k in (1, 2))
    # the last bin is unbounded: its mean brightness follows from the pixel's mean
    last = np.maximum((count * film.mean - first) / np.where(most > 0, most, 1.0), nodes[-2])
    first, second = first + most * last, second + most * last**2
    variance: Doubles = np.maximum(second - first**2 / count, 0.0) / np.maximum(count - 1.0, 1.0)
    return variance
