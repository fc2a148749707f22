"""Outliers: defective pixels, specks on the chart, and places hidden from the camera."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from procedures.numerics.arrays import Mask, quantile
from procedures.pattern_psf.observation import Observation
from procedures.pattern_psf.refine import ChartFit

OUTLIER_SIGMAS = 6.0  # robust standard deviations beyond which no noise explains a sample
PATCH_PX = 9  # side of the windows of the local mean square residual, which is then known to a sixth
MAX_LOCAL_RATIO = 2.5  # mean square residual of a window, over the median, above which the chart is hidden there
LEVEL_MARGIN = 0.5
"""Distance below black or above white, in units of their contrast and in addition to noise, that no sample of the chart
reaches even if sharpened. A few extreme samples would dominate the fit."""
STRAY_SHARE = 0.1
"""Share of the residual's sum of squares above which hot or dead samples are excluded, however few they are."""
MAX_REFITS = 3  # greatest number of exclusions, as large specks hide small ones


@dataclass(frozen=True)
class ExcludedSamples:
    """Samples excluded from a fit.

    connected : share of the samples excluded together with a neighbour: something covers the chart; stray : number of
    isolated samples excluded: hot or dead pixels.
    """

    connected: float
    stray: int


def excluded_samples(whole: Observation, kept: Observation) -> ExcludedSamples:
    """Count the samples of the whole observation that were not kept."""
    excluded, stray = _excluded(whole, kept)
    count = int(np.count_nonzero(stray))
    return ExcludedSamples((int(np.count_nonzero(excluded)) - count) / len(whole), count)


def _excluded(whole: Observation, kept: Observation) -> tuple[Mask, Mask]:
    """Masks (m,) of the whole observation's samples that were not kept, and of the isolated ones among them."""
    excluded = np.zeros((int(whole.rows.max()) + 1, int(whole.columns.max()) + 1), dtype=np.float32)
    excluded[whole.rows, whole.columns] = 1
    excluded[kept.rows, kept.columns] = 0
    around = cv2.boxFilter(excluded, -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT)
    at = whole.rows, whole.columns
    return excluded[at] == 1, (excluded * around)[at] == 1


def within_levels(o: Observation) -> Observation:
    """Exclude the samples far outside black and white, before any fit."""
    margin = LEVEL_MARGIN + OUTLIER_SIGMAS / o.weight
    return o.where((o.y > -margin) & (o.y < 1 + margin))


def refit_iteratively(
    fit: ChartFit,
    again: Callable[[Observation], ChartFit],
    clean: Callable[[ChartFit], Observation],
    fewest: int,
    most: int = MAX_REFITS,
) -> ChartFit:
    """Repeat the fit by `again` to the samples that `clean` keeps, until it keeps nearly all of them, or too few."""
    few = max(10, 1e-3 * len(fit.observation))
    for _ in range(most):
        kept = clean(fit)
        if len(kept) < fewest or (len(kept) >= len(fit.observation) - few and not _strays_dominate(fit, kept)):
            break
        fit = again(kept)
    return fit


def _strays_dominate(fit: ChartFit, kept: Observation) -> bool:
    """Whether hot or dead samples contribute much of the residual's sum of squares."""
    if len(kept) == len(fit.observation):
        return False
    square = fit.residual**2
    return float(square[_excluded(fit.observation, kept)[1]].sum()) > STRAY_SHARE * float(square.sum())


def without_outliers(fit: ChartFit) -> Observation:
    """Exclude the samples that noise does not explain: specks, scratches, a wire in front of the chart."""
    scale = 1.4826 * quantile(np.abs(fit.residual), 0.5)
    return fit.observation.where(np.abs(fit.residual) < OUTLIER_SIGMAS * scale)


def without_hidden_places(fit: ChartFit) -> Observation:
    """Exclude the places that fit far worse than most: under a finger, in a reflection."""
    o = fit.observation
    square, used = np.zeros((2, int(o.rows.max()) + 1, int(o.columns.max()) + 1))
    square[o.rows, o.columns], used[o.rows, o.columns] = fit.residual**2, 1.0
    means = (
        cv2.blur(grid, (PATCH_PX, PATCH_PX), borderType=cv2.BORDER_CONSTANT)[o.rows, o.columns]
        for grid in (square, used)
    )
    local = np.divide(*means)
    return o.where(local < MAX_LOCAL_RATIO * quantile(local, 0.5))
