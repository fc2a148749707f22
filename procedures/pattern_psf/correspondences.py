"""Correspondences: image positions of the noise region's bins, each measured by its own cells, with covariances.

The registration is smooth, a homography and cubics common to all cells. Errors of the print and high-order distortion
remain in the residual. In every bin the residual r and the prediction's slopes J give the displacement that the smooth
map lacks, d = (J'J)^-1 J'r: a Gauss-Newton step of that bin alone. The sum of map and step is determined by the bin's
own cells, whatever the errors of the smooth map. The errors of different bins are therefore independent but for the
PSF's centre, which translates the whole chart and has no effect on the estimated distortion.
"""

from dataclasses import dataclass

import numpy as np

from procedures.numerics.arrays import Array, Indices, Mask, quantile
from procedures.pattern import CELLS
from procedures.pattern_psf.refine import ChartFit

BINS = 24  # bins along one side of the noise region
MIN_INFORMATION = 0.25
"""Least information of a bin relative to the median; bins with less, at the border or partly hidden, are excluded."""


@dataclass(frozen=True)
class Correspondences:
    """Image positions of the chart's bins.

    index : (n,) int64 indices of the bins, row by row of `bin_centres`
    points : (n, 2) images of their centres, (x, y) in pixels of the plane
    covariance : (n, 2, 2) covariance of each point, in squared pixels
    """

    index: Indices
    points: Array
    covariance: Array

    @property
    def cells(self) -> Array:
        """The bins' centres (n, 2) in cells."""
        return bin_centres()[self.index]

    def take(self, chosen: Mask) -> "Correspondences":
        """Some of the bins."""
        return Correspondences(self.index[chosen], self.points[chosen], self.covariance[chosen])


def bin_centres() -> Array:
    """The bins' centres (x, y) in cells, row by row, (BINS^2, 2)."""
    along = (np.arange(BINS) + 0.5) * CELLS / BINS
    x, y = np.meshgrid(along, along)
    return np.column_stack([x.ravel(), y.ravel()])


def correspondences(fit: ChartFit) -> Correspondences:
    """Measure the positions of the bins from the residual of a completed joint fit in each of them."""
    if len(fit.slopes) != len(fit.observation):  # the cells were not recognised: there was no refinement
        nothing = np.zeros((0, 2))
        return Correspondences(np.zeros(0, dtype=np.int64), nothing, np.zeros((0, 2, 2)))
    cells = fit.registration.to_pattern(fit.observation.points)
    column, row = np.clip(cells * BINS / CELLS, 0, BINS - 1).astype(np.int64).T
    JJ, Jr = normal_equations(fit.slopes, fit.residual, row * BINS + column, BINS * BINS)
    index = informed(JJ)
    inverse: Array = np.asarray(np.linalg.inv(JJ[index]), dtype=np.float64)
    # the cell that the map has at p lies at p - d
    step = np.einsum("nab,nb->na", inverse, Jr[index])
    points = fit.registration.to_sensor(bin_centres()[index]) - step
    return Correspondences(index, points, np.asarray(inverse * fit.residual_std**2, dtype=np.float64))


def normal_equations(slopes: Array, residual: Array, which: Indices, count: int) -> tuple[Array, Array]:
    """Normal equations of every bin: J'J (count, 2, 2) and J'r (count, 2)."""
    JJ, Jr = np.zeros((count, 2, 2)), np.zeros((count, 2))
    for a in range(2):
        Jr[:, a] = np.bincount(which, slopes[:, a] * residual, count)
        for b in range(2):
            JJ[:, a, b] = np.bincount(which, slopes[:, a] * slopes[:, b], count)
    return JJ, Jr


def informed(JJ: Array) -> Indices:
    """Indices of the bins whose information is comparable to the median."""
    least = np.linalg.eigvalsh(JJ)[:, 0]
    positive = least[least > 0]
    median = quantile(positive, 0.5) if len(positive) else np.inf
    return np.flatnonzero(least > MIN_INFORMATION * median)
