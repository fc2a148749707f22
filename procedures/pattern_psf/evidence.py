"""Evidence of corruptions in a photograph of the chart: scores by noise, noise region and frame."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from procedures.corruption import directions
from procedures.corruption.directions import BORDER
from procedures.corruption.noise import DRIFT, MaskScore, Variogram, combined_scores, mask_scores, texture_correlation
from procedures.corruption.scores import SampleGroup, Strength, strengths
from procedures.numerics.arrays import Array, Array32
from procedures.numerics.kernel_tail import far_light
from procedures.pattern import Chart
from procedures.pattern_psf.radiometry import LightLevels
from procedures.pattern_psf.rasterise import band_limited_chart
from procedures.pattern_psf.refine import TILES, ChartFit, linear_system
from procedures.pattern_psf.whole_chart import WholeChart

MASK_RADII = (0.6, 1.0, 2.0)
"""Radii of the unsharp masks that are searched for in the noise, in pixels."""
AMOUNT_ABSORBED = 2.0
"""Amount of a mask that clean residuals show, per part of their noise that the fit has absorbed: 1.5 to 2.5."""
SMOOTHING_RADII = (0.5, 0.7)
"""Radii of negative masks by which smoothing is searched for."""
TEXTURES = (1.0, 2.0)
"""Textures of paper: exponents of the frequency by which their spectra fall."""


@dataclass(frozen=True)
class ChartEvidence:
    """Scores of a photograph.

    Attributes
    ----------
    masks : unsharp masks of `MASK_RADII` in the noise of paper and residual
    textured : masks of `SMOOTHING_RADII` where paper and residual may have textures, which the lens images
    strengths : by the directions of `procedures.corruption.directions`
    """

    masks: list[MaskScore]
    textured: list[MaskScore]
    strengths: Mapping[str, Strength]


def examine(
    fit: ChartFit,
    samples: Array32,
    light: LightLevels,
    chart: Chart,
    s: int,
    k: int,
    noise: tuple[Variogram, Variogram],
    curve: tuple[Array, Array],
) -> ChartEvidence:
    """Scores of a fit; `noise` are the variograms of its paper and residual, `curve` frequencies and MTF."""
    paper, residual = noise
    textures = [texture_correlation(*curve, exponent) for exponent in TEXTURES]
    return ChartEvidence(
        combined_scores(mask_scores([paper], MASK_RADII, [DRIFT]), _in_residual(residual, k**2 / fit.residual.size)),
        mask_scores([paper, residual], SMOOTHING_RADII, [DRIFT, *textures]),
        _strengths(fit, samples, light, chart, s, k),
    )


def _in_residual(residual: Variogram, absorbed: float) -> list[MaskScore]:
    """Masks in the noise of the residual, of which the fit has absorbed a part: that looks like a mask too."""
    scores = mask_scores([residual], MASK_RADII)
    return [replace(one, uncertainty=math.hypot(one.uncertainty, AMOUNT_ABSORBED * absorbed)) for one in scores]


def _strengths(
    fit: ChartFit, samples: Array32, light: LightLevels, chart: Chart, s: int, k: int
) -> dict[str, Strength]:
    """Strengths of the directions, each by itself, in noise region and frame together."""
    raster, o = band_limited_chart(chart, fit.registration, s), fit.observation
    whole = WholeChart.of(fit, samples, light, raster, k)
    window = o.window
    levels = float(light.black[0]), float(light.white[0])
    far = far_light(samples, (window.x, window.y), (window.rows, window.columns), s, k, levels)
    shared, own, gram = linear_system(fit, chart, raster, window, k, far)
    row, column = (np.minimum(one * TILES // (one.max() + 1), TILES - 1) for one in (o.rows, o.columns))
    cells, (frame, used) = SampleGroup(shared, own, fit.residual, row * TILES + column), whole.frame
    pictures = _pictures(whole, samples, levels)
    at = o.rows + window.y - whole.window.y, o.columns + window.x - whole.window.x
    in_cells = np.stack([one[at] for one in pictures.values()], axis=1) * o.weight[:, None]
    in_frame = np.stack([one[used] for one in pictures.values()], axis=1) * whole.weight[used][:, None]
    gram = gram + frame.projected_gram()
    return dict(zip(pictures, strengths([cells, frame], [in_cells, in_frame], gram, fit.residual_std), strict=True))


def _pictures(whole: WholeChart, samples: Array32, levels: tuple[float, float]) -> dict[str, Array]:
    """All directions (rows, columns) over the whole chart."""
    wide, window = whole.surrounded, whole.window
    y, x = (
        (first + np.arange(-BORDER, n + BORDER) - (most - 1) / 2) / whole.fit.registration.radius
        for first, n, most in zip((window.y, window.x), whole.value.shape, samples.shape, strict=True)
    )
    pictures = directions.filters(wide) | directions.wide_masks(wide) | directions.variations(wide, *np.meshgrid(x, y))
    ghost = directions.mirrored(samples, (window.x, window.y), whole.value.shape)
    cut = {name: one[BORDER:-BORDER, BORDER:-BORDER] for name, one in pictures.items()}
    return cut | {directions.GHOST: (ghost - levels[0]) / (levels[1] - levels[0])}
