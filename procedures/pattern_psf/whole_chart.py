"""Picture of the whole chart, noise region and frame, as a fit predicts it, and the frame's samples as a test of it.

The fit sees the noise region alone. The frame shows straight edges of full contrast: through the same linear lens they
look as the fit predicts. A filter that is not linear treats them otherwise than the cells.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from procedures.corruption.directions import BORDER
from procedures.corruption.scores import SampleGroup
from procedures.numerics import loops
from procedures.numerics.arrays import Array, Array32, Mask
from procedures.numerics.kernel_tail import SHAPES, far_light, tail_border, tail_columns, tail_sums
from procedures.numerics.sampled_convolution import sample_convolution
from procedures.numerics.warps import apply_homography, cubic_monomials, displacement_columns
from procedures.pattern import BLOCK, BLOCKS, CELLS, X_CORNER_BLOCKS
from procedures.pattern_psf.radiometry import LightLevels, quadratic
from procedures.pattern_psf.rasterise import Raster, Window
from procedures.pattern_psf.refine import TAIL, ChartFit
from procedures.pattern_psf.registration import block_size_px

CLEAR_PX = 1.5
"""Least distance of the frame's samples from the blocks of the x-corners, whose diagonals are stairs of cells here."""
MIN_BLOCK_SAMPLES = 12
"""Least number of samples of a block."""
HIDDEN = 2.5
"""Residual of a block, relative to the median one, above which something covers it."""


@dataclass(frozen=True)
class WholeChart:
    """The chart's picture in a window.

    Attributes
    ----------
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
    def of(cls, fit: ChartFit, samples: Array32, light: LightLevels, chart: Raster, k: int) -> WholeChart:
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
        """The blocks of the frame as a test of the fit, and the mask (rows, columns) of their samples.

        Every block has a plane of light of its own, and the frame a displacement. The shared columns are those of the
        PSF, then of the tail.
        """
        block = np.floor(self.cells / BLOCK + 1).astype(int)
        number = block[..., 0] + BLOCKS * block[..., 1]
        used = self._clear(block)
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

    def _clear(self, block: npt.NDArray[np.int64]) -> Mask:
        """Samples of the frame away from x-corners and from the rim, beyond which the surroundings are not known."""
        cell_px = block_size_px(self.fit.registration) / BLOCK
        rim, near = self.k / 2 / self.s / cell_px, CLEAR_PX / cell_px
        inside = ((self.cells > rim - BLOCK) & (self.cells < CELLS + BLOCK - rim)).all(axis=2)
        noise = ((self.cells > 0) & (self.cells < CELLS)).all(axis=2)
        corner = np.zeros((BLOCKS, BLOCKS), dtype=bool)
        corner[tuple(np.array(X_CORNER_BLOCKS).T)] = True
        touched = np.zeros(noise.shape, dtype=bool)
        for x in (-near, 0.0, near):
            for y in (-near, 0.0, near):
                at = np.clip(np.floor((self.cells + np.array([x, y])) / BLOCK + 1).astype(int), 0, BLOCKS - 1)
                touched |= corner[at[..., 0], at[..., 1]]
        return np.asarray(inside & ~noise & ~touched)

    def _part(self, used: Mask, number: npt.NDArray[np.int64]) -> SampleGroup:
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
        own = np.hstack([planes.reshape(len(rows), -1), moved]) * weight[:, None]
        return SampleGroup(shared, own, (self.value - self.prediction)[used] * weight, cluster.astype(np.int64))


def _outside(shape: tuple[int, ...], window: Window, s: int, border: int, H: Array) -> Mask:
    """Samples of the s grid that lie outside of the chart."""
    y, x = ((np.arange(n) - border) / s + first for n, first in zip(shape, (window.y, window.x), strict=True))
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    cells = apply_homography(H, points)
    return np.asarray(((cells < -BLOCK) | (cells > CELLS + BLOCK)).any(axis=1).reshape(shape))
