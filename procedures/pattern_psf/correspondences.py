"""Where parts of the chart are seen: the noise region in bins, each placed by its own cells, with its covariance.

The registration is smooth: a homography and cubics that all cells share. What the print's own errors and a lens of high
order add to it is left in the residual. In every bin the residual r and the prediction's slopes J give the displacement
that the smooth map lacks, d = (J'J)^-1 J'r: a Gauss-Newton step of that bin alone. Map and step together are where the
bin's own cells put it, whatever the smooth map's errors are, so that the errors of different bins have nothing in
common but the PSF's centre, which moves the whole chart and so tells nothing of the lens.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.numerics.ordered import quantile
from procedures.pattern import CELLS
from procedures.pattern_psf.refine import ChartFit

Array = npt.NDArray[np.float64]

BINS = 24
"""Bins along one side of the noise region."""
LEAST_SHARE = 0.25
"""Of the usual bin's information: bins with less lie at the rim or behind something, and are left out."""


@dataclass(frozen=True)
class Correspondences:
    """Where the chart's bins are seen.

    Attributes
    ----------
    index : (n,) int64
        Which bins, row by row of `bin_centres`.
    points : (n, 2) float64
        Where their centres are seen, (x, y) in pixels of the plane.
    covariance : (n, 2, 2) float64
        Of each, in squared pixels.
    """

    index: npt.NDArray[np.int64]
    points: Array
    covariance: Array

    @property
    def cells(self) -> Array:
        """The bins' centres (n, 2) in cells."""
        return bin_centres()[self.index]


def bin_centres(bins: int = BINS) -> Array:
    """The bins' centres (x, y) in cells, row by row, (bins^2, 2)."""
    along = (np.arange(bins) + 0.5) * CELLS / bins
    x, y = np.meshgrid(along, along)
    return np.column_stack([x.ravel(), y.ravel()])


def correspondences(fit: ChartFit) -> Correspondences:
    """Where the bins are seen, from what the joint fit leaves in each of them.

    Parameters
    ----------
    fit : ChartFit
        Of a refinement that came to its end: its slopes are those of its samples.
    """
    if len(fit.slopes) != len(fit.observation):  # the cells were not found: there was no refinement
        nothing = np.zeros((0, 2))
        return Correspondences(np.zeros(0, dtype=np.int64), nothing, np.zeros((0, 2, 2)))
    which = _bin_of(fit.registration.to_pattern(fit.observation.points))
    JJ, Jr = normal_equations(fit.slopes, fit.residual, which, BINS * BINS)
    index = informed(JJ)
    inverse: Array = np.asarray(np.linalg.inv(JJ[index]), dtype=np.float64)
    # the map at p should see what it sees at p + d, so what it sees at p is seen at p - d
    step = np.einsum("nab,nb->na", inverse, Jr[index])
    points = fit.registration.to_sensor(bin_centres()[index]) - step
    return Correspondences(index, points, np.asarray(inverse * fit.residual_std**2, dtype=np.float64))


def _bin_of(cells: Array) -> npt.NDArray[np.int64]:
    """The bin (n,) in which cells (n, 2) lie."""
    column, row = np.clip(cells * BINS / CELLS, 0, BINS - 1).astype(np.int64).T
    return np.asarray(row * BINS + column)


def normal_equations(slopes: Array, residual: Array, which: npt.NDArray[np.int64], count: int) -> tuple[Array, Array]:
    """J'J (count, 2, 2) and J'r (count, 2) of every bin."""
    JJ, Jr = np.zeros((count, 2, 2)), np.zeros((count, 2))
    for a in range(2):
        Jr[:, a] = np.bincount(which, slopes[:, a] * residual, count)
        for b in range(2):
            JJ[:, a, b] = np.bincount(which, slopes[:, a] * slopes[:, b], count)
    return JJ, Jr


def informed(JJ: Array) -> npt.NDArray[np.int64]:
    """The bins whose samples tell their place about as well as those of others do."""
    least = np.linalg.eigvalsh(JJ)[:, 0]
    seen = least[least > 0]
    usual = quantile(seen, 0.5) if len(seen) else np.inf
    return np.flatnonzero(least > LEAST_SHARE * usual)
