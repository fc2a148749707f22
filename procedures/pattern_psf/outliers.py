"""Samples that show something other than the chart: the sensor's own faults, specks, and whole places hidden from the
camera."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

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
BEYOND = 0.5
"""Of the contrast between black and white beyond either, and beyond noise: no light of the chart, its edges sharpened
or not, makes a sample that. A few of them outweigh all of the chart where they are far beyond."""
STRAYS_SQUARE = 0.1
"""Share of the residual's square from which hot or dead samples are left out however few they are."""
MOST_SWEEPS = 3
"""How often samples are left out, as large specks hide small ones."""


@dataclass(frozen=True)
class LeftOut:
    """What a fit goes without.

    Attributes
    ----------
    strange : float
        Share of the samples that do not fit together with a neighbour: something lies on the chart or before it.
    stray : int
        Number of samples that do not fit while all eight around them do: hot or dead ones of the sensor.
    """

    strange: float
    stray: int


def left_out(whole: Observation, kept: Observation) -> LeftOut:
    """What of the whole observation was not kept."""
    lost, stray = _lost(whole, kept)
    count = int(np.count_nonzero(stray))
    return LeftOut((int(np.count_nonzero(lost)) - count) / len(whole), count)


def _lost(whole: Observation, kept: Observation) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """Which of the whole observation's samples (m,) were not kept, and which of those have none beside them."""
    lost = np.zeros((int(whole.rows.max()) + 3, int(whole.columns.max()) + 3), dtype=np.int64)  # a rim of one pixel
    lost[whole.rows + 1, whole.columns + 1] = 1
    lost[kept.rows + 1, kept.columns + 1] = 0
    around = sum(np.roll(lost, (i, j), (0, 1)) for i in (-1, 0, 1) for j in (-1, 0, 1))
    at = whole.rows + 1, whole.columns + 1
    return lost[at] == 1, (lost * around)[at] == 1


def within_reach(o: Observation) -> Observation:
    """The observation without the samples that no light of the chart makes, before anything is fitted."""
    margin = BEYOND + SPECK / o.weight
    return o.where((o.y > -margin) & (o.y < 1 + margin))


def swept(
    fit: ChartFit,
    again: Callable[[Observation], ChartFit],
    clean: Callable[[ChartFit], Observation],
    fewest: int,
    most: int = MOST_SWEEPS,
) -> ChartFit:
    """A fit `again` to what `clean` leaves of its samples, until that leaves nearly all that tell, or too few."""
    few = max(10, 1e-3 * len(fit.observation))
    for _ in range(most):
        kept = clean(fit)
        if len(kept) < fewest or (len(kept) >= len(fit.observation) - few and not _strays_tell(fit, kept)):
            break
        fit = again(kept)
    return fit


def _strays_tell(fit: ChartFit, kept: Observation) -> bool:
    """Whether hot or dead samples, as few as they are, make much of what the fit leaves over."""
    if len(kept) == len(fit.observation):
        return False
    square = fit.residual**2
    return float(square[_lost(fit.observation, kept)[1]].sum()) > STRAYS_SQUARE * float(square.sum())


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
