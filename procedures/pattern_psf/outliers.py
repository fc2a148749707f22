"""Samples that show something other than the chart: specks, one by one, and whole places hidden from the camera."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from procedures.numerics.ordered import quantile
from procedures.pattern_psf.observation import Observation
from procedures.pattern_psf.refine import ChartFit

Array = npt.NDArray[np.float64]

SPECK = 6.0
"""Robust standard deviations beyond which no noise explains a sample."""
PATCH_PX = 9
"""Side of the windows whose residual is compared: large enough for its mean square to be known to a sixth."""
STRANGE = 2.5
"""Mean square of the residual in a window, over that of half of them, from which something else is seen there."""
MOST_SWEEPS = 3
"""How often samples are left out, as large specks hide small ones."""


def swept(
    fit: ChartFit,
    again: Callable[[Observation], ChartFit],
    clean: Callable[[ChartFit], Observation],
    fewest: int,
    most: int = MOST_SWEEPS,
) -> ChartFit:
    """A fit `again` to what `clean` leaves of its samples, until that leaves nearly all of them, or too few."""
    few = max(10, 1e-3 * len(fit.observation))
    for _ in range(most):
        kept = clean(fit)
        if len(kept) >= len(fit.observation) - few or len(kept) < fewest:
            break
        fit = again(kept)
    return fit


def without_outliers(fit: ChartFit) -> Observation:
    """The observation without the samples that no noise explains: specks, scratches, a wire before the chart."""
    scale = 1.4826 * quantile(np.abs(fit.residual), 0.5)
    return fit.observation.where(np.abs(fit.residual) < SPECK * scale)


def without_places(fit: ChartFit) -> Observation:
    """The observation without the places that fit far worse than most: under a finger, in a reflection."""
    from scipy.ndimage import uniform_filter  # here: few photographs need it, and it is slow to load

    o = fit.observation
    square, seen = np.zeros((2, int(o.rows.max()) + 1, int(o.columns.max()) + 1))
    square[o.rows, o.columns], seen[o.rows, o.columns] = fit.residual**2, 1.0
    means = (uniform_filter(grid, PATCH_PX, mode="constant")[o.rows, o.columns] for grid in (square, seen))
    local = np.divide(*means)
    return o.where(local < STRANGE * quantile(local, 0.5))
