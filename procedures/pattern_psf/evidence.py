"""Evidence of corruptions in a photograph of the chart: scores by noise, noise region and frame."""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from procedures.corruption import directions
from procedures.corruption.directions import BORDER
from procedures.corruption.evidence import TextureEvidence
from procedures.corruption.family import SampleGroup, Strength, strengths
from procedures.corruption.noise import (
    DRIFT,
    MASK_RADII,
    SMOOTHING_RADII,
    TEXTURES,
    Variogram,
    combined_scores,
    mask_scores,
    texture_correlation,
)
from procedures.numerics import loops
from procedures.numerics.arrays import Array, Array32, Indices, Mask
from procedures.numerics.kernel_tail import SHAPES, far_light, tail_border, tail_columns, tail_sums
from procedures.numerics.transforms import sample_convolution
from procedures.numerics.warps import cubic_monomials, displacement_columns
from procedures.pattern import BLOCK, BLOCKS, CELLS, X_CORNER_BLOCKS, Chart
from procedures.pattern_psf.radiometry import LightLevels, quadratic
from procedures.pattern_psf.rasterise import Raster, Window, band_limited_chart
from procedures.pattern_psf.refine import TAIL, TILES, ChartFit, linear_system
from procedures.pattern_psf.registration import block_size_px

AMOUNT_ABSORBED = 2.0
"""Amount of a mask that clean residuals show, per part of their noise that the fit has absorbed: 1.5 to 2.5."""


def examine(
    fit: ChartFit,
    samples: Array32,
    light: LightLevels,
    chart: Chart,
    s: int,
    k: int,
    noise: tuple[Variogram, Variogram],
    curve: tuple[Array, Array],
) -> TextureEvidence:
    """Scores of a fit; `noise` are the variograms of its paper and residual, `curve` frequencies and MTF."""
    paper, residual = noise
    textures = [texture_correlation(*curve, exponent) for exponent in TEXTURES]
    return TextureEvidence(
        combined_scores(mask_scores([paper], MASK_RADII, [DRIFT]), _in_residual(residual, k**2 / fit.residual.size)),
        mask_scores([paper, residual], SMOOTHING_RADII, [DRIFT, *textures]),
        _strengths(fit, samples, light, chart, s, k),
        mosaic=max(paper.mosaic.score, residual.mosaic.score),
    )


def _in_residual(residual: Variogram, absorbed: float) -> list[Strength]:
    """Masks in the noise of the residual, of which the fit has absorbed a part: that looks like a mask too."""
    scores = mask_scores([residual], MASK_RADII)
    return [replace(score, uncertainty=math.hypot(score.uncertainty, AMOUNT_ABSORBED * absorbed)) for score in scores]


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
    in_cells = np.stack([picture[at] for picture in pictures.values()], axis=1) * o.weight[:, None]
    in_frame = np.stack([picture[used] for picture in pictures.values()], axis=1) * whole.weight[used][:, None]
    gram = gram + frame.projected_gram()
    return dict(zip(pictures, strengths([cells, frame], [in_cells, in_frame], gram, fit.residual_std), strict=True))


def _pictures(whole: "WholeChart", samples: Array32, levels: tuple[float, float]) -> dict[str, Array]:
    """All directions (rows, columns) over the whole chart."""
    wide, window = whole.surrounded, whole.window
    y, x = (
        (first + np.arange(-BORDER, n + BORDER) - (most - 1) / 2) / whole.fit.registration.radius
        for first, n, most in zip((window.y, window.x), whole.value.shape, samples.shape, strict=True)
    )
    pictures = directions.filters(wide) | directions.wide_masks(wide) | directions.variations(wide, *np.meshgrid(x, y))
    ghost = directions.mirrored(samples, (window.x, window.y), whole.value.shape)
    cut = {name: picture[BORDER:-BORDER, BORDER:-BORDER] for name, picture in pictures.items()}
    return cut | {directions.GHOST: (ghost - levels[0]) / (levels[1] - levels[0])}


# --- the whole chart ---
# The fit sees the noise region alone. The frame shows straight edges of full contrast: through the same linear lens
# they look as the fit predicts. A filter that is not linear treats them otherwise than the cells.

CLEAR_PX = 1.5
"""Least distance of the frame's samples from the blocks of the x-corners, whose diagonals are stairs of cells here."""
MIN_BLOCK_SAMPLES = 12  # least number of samples of a block
HIDDEN = 2.5  # residual of a block, relative to the median one, above which something covers it


@dataclass(frozen=True)
class WholeChart:
    """The chart's picture in a window.

    prediction, value, weight : (rows, columns) black 0 and white 1: as predicted, as photographed; the reciprocal of
        the noise
    slopes : (rows, columns, 2) derivative of the prediction by a shift along x and y
    cells : (rows, columns, 2) positions (x, y) in cells
    raster : (s (rows - 1) + k, s (columns - 1) + k) float32 the chart on the s grid, with a border
    tail : (rows, columns, q) the chart through the shapes of the far tail
    """

    fit: ChartFit
    window: Window
    s: int
    k: int
    prediction: Array
    value: Array
    weight: Array
    slopes: Array
    cells: Array
    raster: Array32
    tail: Array

    @classmethod
    def of(cls, fit: ChartFit, samples: Array32, light: LightLevels, chart: Raster, k: int) -> "WholeChart":
        """Predict the picture of the whole chart by a fit to its noise region."""
        registration = fit.registration
        window = Window.around(registration, samples.shape, float(BLOCK), 0.0)
        shape = (window.rows, window.columns)
        s, border = chart.s, tail_border(k)
        wide = chart.read(registration, window, border)
        wide[_outside(wide.shape, window, s, border, registration.H)] = 0.5
        extra = border - k // 2
        inner = np.ascontiguousarray(wide[extra : len(wide) - extra, extra : wide.shape[1] - extra])
        rows, columns = (one.ravel() for one in np.mgrid[: shape[0], : shape[1]])
        h = fit.h.reshape(k, k)
        slope_y, slope_x = np.gradient(h)
        parts = [loops.convolve_at(inner, rows, columns, one.astype(np.float32), s) for one in (h, slope_x, slope_y)]
        outline = chart.read(registration, window, k // 2, outline=True)
        spread = loops.convolve_at(outline, rows, columns, h.astype(np.float32), s)
        levels = float(light.black[0]), float(light.white[0])
        tail = tail_columns(wide, rows, columns, s, k)
        tail[:, 0] += far_light(samples, (window.x, window.y), shape, s, k, levels).ravel()
        points = window.pixels().astype(np.float64)
        place = ((points - registration.centre) / registration.radius).T
        quadratics, amplitudes = quadratic(*place), fit.light[TAIL:]
        middle = (float(fit.h.sum()) + float(tail_sums(k) @ amplitudes)) / 2
        m = (parts[0] + tail @ amplitudes + middle)[:, None]
        columns_of_light = np.hstack([quadratics, quadratics[:, 1:] * m, m * m - m, spread[:, None], tail])
        contrast = quadratics @ (light.white - light.black)
        value = (window.cut(samples).ravel() - quadratics @ light.black) / contrast
        weight = contrast / np.sqrt(light.variance_at(value))
        return cls(
            fit, window, s, k,
            (parts[0] + columns_of_light @ fit.light).reshape(shape),
            value.reshape(shape),
            weight.reshape(shape),
            np.stack(parts[1:], axis=1, dtype=np.float64).reshape(*shape, 2) * s,
            registration.to_pattern(points).reshape(*shape, 2),
            inner,
            tail.reshape(*shape, len(SHAPES)),
        )  # fmt: skip

    @property
    def surrounded(self) -> Array:
        """The prediction with `BORDER` pixels of white paper around it."""
        outside = ((self.cells < -BLOCK) | (self.cells > CELLS + BLOCK)).any(axis=2)
        return np.pad(np.where(outside, 1.0, self.prediction), BORDER, constant_values=1.0)

    @cached_property
    def frame(self) -> tuple[SampleGroup, Mask]:
        """The frame's blocks as a test of the fit, each with a plane of light, and the mask (rows, columns) of their
        samples. Shared columns are those of PSF and tail."""
        block = np.floor(self.cells / BLOCK + 1).astype(int)
        number = block[..., 0] + BLOCKS * block[..., 1]
        # samples of the frame away from x-corners and from the rim, beyond which the surroundings are not known
        cell_px = block_size_px(self.fit.registration) / BLOCK
        rim, near = self.k / 2 / self.s / cell_px, CLEAR_PX / cell_px
        inside = ((self.cells > rim - BLOCK) & (self.cells < CELLS + BLOCK - rim)).all(axis=2)
        noise = ((self.cells > 0) & (self.cells < CELLS)).all(axis=2)
        corner = np.zeros((BLOCKS, BLOCKS), dtype=bool)
        corner[tuple(np.array(X_CORNER_BLOCKS).T)] = True
        touched = np.zeros(noise.shape, dtype=bool)
        for x in (-near, near):  # a block is wider than both
            for y in (-near, near):
                at = np.clip(np.floor((self.cells + np.array([x, y])) / BLOCK + 1).astype(int), 0, BLOCKS - 1)
                touched |= corner[at[..., 0], at[..., 1]]
        used = np.asarray(inside & ~noise & ~touched)
        if used.any():
            count = np.bincount(number[used], minlength=BLOCKS * BLOCKS)
            used &= (count >= MIN_BLOCK_SAMPLES)[np.clip(number, 0, BLOCKS * BLOCKS - 1)]
        part = self._part(used, number)
        for _ in range(2):
            if not len(part.residual):
                break
            square = part.without_own(part.residual[:, None])[:, 0] ** 2
            rms = np.sqrt(np.bincount(part.cluster, square) / np.bincount(part.cluster))
            hidden = rms > HIDDEN * np.median(rms)
            if not hidden.any():
                break
            used[used] = ~hidden[part.cluster]
            part = self._part(used, number)
        return part, used

    def _part(self, used: Mask, number: Indices) -> SampleGroup:
        rows, columns = np.nonzero(used)
        weight = self.weight[used]
        q = len(SHAPES)
        shared = sample_convolution(self.raster, rows, columns, weight.astype(np.float32), self.s, self.k, q)
        shared[:, -q:] = self.tail[used] * weight[:, None]
        registration = self.fit.registration
        points = np.column_stack([columns + self.window.x, rows + self.window.y]).astype(np.float64)
        place = (points - registration.centre) / registration.radius
        numbers, cluster = np.unique(number[used], return_inverse=True)
        planes = np.zeros((len(rows), len(numbers), 3))
        count = np.bincount(cluster)
        middle = np.stack([np.bincount(cluster, one) / count for one in place.T], axis=1)
        planes[np.arange(len(rows)), cluster] = np.column_stack([np.ones(len(rows)), place - middle[cluster]])
        moved = displacement_columns(self.slopes[used], cubic_monomials(*place.T))
        own = np.hstack([planes.reshape(len(rows), 3 * len(numbers)), moved]) * weight[:, None]
        return SampleGroup(shared, own, (self.value - self.prediction)[used] * weight, cluster.astype(np.int64))


def _outside(shape: tuple[int, int], window: Window, s: int, border: int, H: Array) -> Mask:
    """Samples of the s grid that lie outside of the chart."""
    y, x = ((np.arange(n) - border) / s + first for n, first in zip(shape, (window.y, window.x), strict=True))
    outside = np.zeros(shape, dtype=bool)
    for a, b, c in (*(H[:2] + BLOCK * H[2]), *((CELLS + BLOCK) * H[2] - H[:2])):  # negative beyond each side
        outside |= a * x + (b * y + c)[:, None] < 0
    return outside
