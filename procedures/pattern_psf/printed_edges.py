"""Offsets of the printed edges: every row and column of cells begins at a dot of the printer.

A printer rounds the edges to its grid of dots, with one error along a whole line of the chart: at 600 dots per inch the
edges of a 300 mm chart have an rms error of 1.3 % of a cell. In the residual it resembles coloured noise. The offsets
of the 514 lines are estimated jointly with the PSF, under a zero-mean prior whose width is estimated from the
photograph.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from procedures.numerics import loops
from procedures.numerics.arrays import Array, Array32
from procedures.numerics.normal_equations import solve_factored
from procedures.numerics.warps import inverse
from procedures.pattern import BLOCK, CELLS
from procedures.pattern_psf.registration import Registration

Indices = npt.NDArray[np.int32]

LINES = CELLS + 1  # lines between the cells along one axis, the noise region's rim included
OVERSAMPLING = 4  # samples of the interpolated PSF per sample of the s grid
MIN_PRIOR_RMS = 0.001  # narrowest prior of the offsets, in cells: a tenth of what any photograph can resolve
CORE_SHARE = 0.03
"""Share of the PSF's peak below which its samples are excluded from the columns, as the offsets are corrections."""


@dataclass(frozen=True)
class EdgeColumns:
    """Sparse matrix C (m, 514), the derivative of the samples by the lines' offsets.

    vertical, horizontal : (m, w) float32 the values of the lines around each sample; first_vertical, first_horizontal :
    (m,) int32 the first of those lines.
    """

    vertical: Array32
    first_vertical: Indices
    horizontal: Array32
    first_horizontal: Indices

    def apply(self, offsets: Array) -> Array:
        """C offsets, (m,)."""
        parts = (self.vertical, self.first_vertical, self.horizontal, self.first_horizontal)
        return np.asarray(loops.apply_edges(*parts, offsets.astype(np.float32)), dtype=np.float64)

    def apply_transposed(self, samples: Array) -> Array:
        """C' samples, (514,)."""
        parts = (self.vertical, self.first_vertical, self.horizontal, self.first_horizontal)
        return np.asarray(loops.apply_edges_transposed(*parts, samples.astype(np.float32), LINES), dtype=np.float64)

    @cached_property
    def gram(self) -> Array:
        """C'C, (514, 514)."""
        half = loops.edge_gram(self.vertical, self.first_vertical, self.horizontal, self.first_horizontal, LINES)
        return np.asarray(half + np.tril(half, -1).T, dtype=np.float64)

    def widths(self, residual: Array) -> tuple[float, float]:
        """The rms of the offsets tau, in cells, and the noise sigma from the residual r without offsets, by the means
        of r^2: sigma^2 + tau^2 tr(C'C) / m, and (C'r)^2: sigma^2 tr(C'C) + tau^2 tr((C'C)^2)."""
        back, trace, m = self.apply_transposed(residual), float(np.trace(self.gram)), len(residual)
        mean_square = float(residual @ residual) / m
        square = (float(back @ back) - mean_square * trace) / (float(np.sum(self.gram**2)) - trace**2 / m)
        rms = float(np.sqrt(max(square, MIN_PRIOR_RMS**2)))
        return rms, float(np.sqrt(max(mean_square - rms**2 * trace / m, 0.1 * mean_square)))

    def estimator(self, rms: float, noise: float) -> Callable[[Array], Array]:
        """Function from the residual without offsets (m,) to the most probable offsets (514,) in cells; `rms` of their
        prior, `noise` of the residual."""
        penalised = self.gram.astype(np.float32)  # the prior makes it well conditioned
        penalised[np.diag_indices(len(penalised))] += np.float32((noise / rms) ** 2)
        factor = np.linalg.cholesky(penalised)

        def offsets(residual: Array) -> Array:
            right_side = self.apply_transposed(residual).astype(np.float32)
            return np.asarray(solve_factored(factor, right_side), dtype=np.float64)

        return offsets


def edge_columns(
    whole: Array32, registration: Registration, points: Array, h: Array, s: int, weight: Array
) -> EdgeColumns:
    """Compute the derivative of the samples by the offsets, vertical lines first, then horizontal ones.

    Each cell's segment of a line is split into pieces of at most half a pixel, each a point source at its middle.

    whole : (320, 320) float32 the chart with its frame
    points : (m, 2) the samples' pixels (x, y)
    h : (k, k) the PSF, its sum the contrast
    weight : (m,) factor of each row
    """
    cells, J, row_weight = registration.to_pattern(points), registration.jacobian(), weight.astype(np.float32)
    inner = slice(BLOCK, BLOCK + CELLS)
    along_x, along_y = whole[inner, BLOCK - 1 : BLOCK + CELLS + 1], whole[BLOCK - 1 : BLOCK + CELLS + 1, inner]
    right = np.ascontiguousarray((along_x[:, :-1] - along_x[:, 1:]).T)
    lower = np.ascontiguousarray(along_y[:-1] - along_y[1:])
    pixels = inverse(J)
    # PSF interpolated band-limited, OVERSAMPLING times as densely, one sample wider on each side
    k = len(h)
    n = (k + 1) * OVERSAMPLING
    t = (np.arange(n + 1) - n // 2) / OVERSAMPLING + k // 2
    S = np.sinc(t[:, None] - np.arange(k))
    interpolated = np.asarray(S @ h @ S.T, dtype=np.float32)
    fine = interpolated * np.float32(s * s * abs(np.linalg.det(pixels)))
    # radius along either axis, in samples, beyond which the PSF is below `CORE_SHARE` of its peak
    rows, columns = np.nonzero(np.abs(h) > CORE_SHARE * np.abs(h).max())
    core_radius = int(max(np.abs(rows - len(h) // 2).max(), np.abs(columns - len(h) // 2).max()))
    reach = np.abs(J).sum(axis=1) * (core_radius + 1) / s
    pieces = int(np.ceil(np.sqrt(abs(np.linalg.det(pixels))) / 0.5))
    scale = pixels * (s * OVERSAMPLING)
    # a horizontal line is a vertical one of the transposed chart
    swapped = np.ascontiguousarray(cells[:, ::-1]), lower, np.ascontiguousarray(fine.T)
    turned = np.ascontiguousarray(scale[::-1, ::-1]), reach[::-1].copy()
    return EdgeColumns(
        *loops.edge_lines(cells, right, fine, scale, reach, pieces, row_weight),
        *loops.edge_lines(*swapped, *turned, pieces, row_weight),
    )
