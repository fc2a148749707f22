"""The edges as they were printed: every row and column of cells begins where a dot of the printer begins.

A printer puts the edges on its own grid of dots, the same error along a whole line of the chart: at 600 dots per inch
a 300 mm chart's edges are off by 1.3 % of a cell in the root mean square. Seen through the PSF that looks like noise
of the chart's own colour; the 514 lines' offsets explain it. They are estimated with the PSF, under a prior of zero
mean whose width comes from the photograph itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt
import scipy.linalg
import scipy.sparse

from procedures.numerics.warps import inverse
from procedures.pattern import BLOCK, CELLS
from procedures.pattern_psf.registration import Registration

Array = npt.NDArray[np.float64]
Array32 = npt.NDArray[np.float32]
Indices = npt.NDArray[np.int32]

LINES = CELLS + 1
"""Lines between the cells along one axis, the noise region's rim included."""
FINE = 4
"""Samples of the interpolated PSF per sample of the s grid."""
LEAST_RMS = 0.001
"""Narrowest prior of the offsets, in cells: a tenth of what any photograph can tell."""
CORE = 0.03
"""Samples of the PSF under this share of its peak are left out of the columns: the offsets are corrections."""


@dataclass(frozen=True)
class Edges:
    """How the samples change with the offsets of the 514 lines of edges, in cells.

    Attributes
    ----------
    C : (m, 514) sparse float32
        From `edge_columns`.
    CC : (514, 514) float64
        C'C.
    """

    C: scipy.sparse.csr_array
    CC: Array

    @classmethod
    def of(cls, columns: scipy.sparse.csr_array) -> Edges:
        """From the columns."""
        return cls(columns, (columns.T @ columns).toarray().astype(np.float64))

    def widths(self, left: Array) -> tuple[float, float]:
        """Root mean square tau of the offsets, in cells, and of the noise, from the residual without offsets (m,).

        The residual's mean square is sigma^2 + tau^2 tr(C'C) / m, that of C'left sigma^2 tr(C'C) + tau^2 tr((C'C)^2).
        What the PSF has already made of the offsets is small, and only makes tau smaller.
        """
        back, trace, m = self.C.T @ left, float(np.trace(self.CC)), len(left)
        mean_square = float(left @ left) / m
        square = (float(back @ back) - mean_square * trace) / (float(np.sum(self.CC**2)) - trace**2 / m)
        rms = float(np.sqrt(max(square, LEAST_RMS**2)))
        return rms, float(np.sqrt(max(mean_square - rms**2 * trace / m, 0.1 * mean_square)))

    def estimator(self, rms: float, noise: float) -> Callable[[Array], Array]:
        """What takes the residual without offsets (m,) to the most probable offsets (514,), in cells.

        `rms` is the width of their prior, in cells, `noise` the standard deviation of the residual beside them.
        """
        ridge = (noise / rms) ** 2
        factor = scipy.linalg.cho_factor(self.CC + ridge * np.eye(2 * LINES), lower=True, check_finite=False)
        return lambda left: np.asarray(scipy.linalg.cho_solve(factor, self.C.T @ left, check_finite=False))


def edge_columns(
    whole: Array32, registration: Registration, points: Array, h: Array, s: int, weight: Array
) -> scipy.sparse.csr_array:
    """Change of the samples when a line of edges moves by one cell: vertical lines first, then horizontal ones.

    Each cell's piece of a line acts as light at its middle, in pieces of at most half a pixel.

    Parameters
    ----------
    whole : (320, 320) float32
        The chart with its frame.
    registration : Registration
    points : (m, 2) float64
        The samples' pixels (x, y).
    h : (k, k) float64
        The PSF, its sum the contrast.
    s : int
    weight : (m,) float64
        Factor of each row.

    Returns
    -------
    (m, 514) sparse float32
    """
    cells, J, scale_of_rows = registration.to_pattern(points), registration.jacobian(), weight.astype(np.float32)
    inner = slice(BLOCK, BLOCK + CELLS)
    along_x, along_y = whole[inner, BLOCK - 1 : BLOCK + CELLS + 1], whole[BLOCK - 1 : BLOCK + CELLS + 1, inner]
    right = np.ascontiguousarray(along_x[:, :-1] - along_x[:, 1:])
    lower = np.ascontiguousarray((along_y[:-1] - along_y[1:]).T)
    pixels = inverse(J)
    fine = _interpolated(h) * np.float32(s * s * abs(np.linalg.det(pixels)))
    reach = np.abs(J).sum(axis=1) * (_core_radius(h) + 1) / s
    pieces = int(np.ceil(np.sqrt(abs(np.linalg.det(pixels))) / 0.5))
    scale = pixels * (s * FINE)
    parts = [
        _lines(cells, right, fine, scale, reach, pieces, scale_of_rows),
        # a horizontal line is a vertical one of the transposed chart
        _lines(*_transposed(cells, lower, fine, scale, reach), pieces, scale_of_rows),
    ]
    return scipy.sparse.hstack([_sparse(*part, len(cells)) for part in parts], format="csr")


def _transposed(
    cells: Array, steps: Array32, fine: Array32, scale: Array, reach: Array
) -> tuple[Array, Array32, Array32, Array, Array]:
    """The same with x and y exchanged."""
    flipped = np.ascontiguousarray(scale[::-1, ::-1])
    return np.ascontiguousarray(cells[:, ::-1]), steps, np.ascontiguousarray(fine.T), flipped, reach[::-1].copy()


def _core_radius(h: Array) -> int:
    """Samples from the centre, along either axis, beyond which the PSF stays under a share of its peak."""
    rows, columns = np.nonzero(np.abs(h) > CORE * np.abs(h).max())
    return int(max(np.abs(rows - len(h) // 2).max(), np.abs(columns - len(h) // 2).max()))


def _interpolated(h: Array) -> Array32:
    """The PSF by its band-limited interpolation, FINE times as dense, a sample wider on each side."""
    k = len(h)
    n = (k + 1) * FINE
    t = (np.arange(n + 1) - n // 2) / FINE + k // 2
    S = np.sinc(t[:, None] - np.arange(k))
    return np.asarray(S @ h @ S.T, dtype=np.float32)


def _sparse(values: Array32, first: Indices, m: int) -> scipy.sparse.csr_array:
    """Rows of equal length that begin at their own line, as a sparse matrix (m, 257)."""
    width = values.shape[1]
    columns = first[:, None] + np.arange(width, dtype=np.int32)
    inside = columns < LINES
    ends = np.concatenate([[0], np.cumsum(inside.sum(axis=1))])
    return scipy.sparse.csr_array((values[inside], columns[inside], ends), shape=(m, LINES))


@numba.njit(cache=True, nogil=True, fastmath=True)
def _lines(
    cells: Array, steps: Array32, fine: Array32, scale: Array, reach: Array, pieces: int, weight: Array32
) -> tuple[Array32, Indices]:  # pragma: no cover - compiled
    """Values (m, width) of the vertical lines around each sample, and the first line of each (m,).

    `steps` (256, 257) is the step of the chart at each cell's left edge, `scale` takes cells to samples of `fine`.
    """
    m = len(cells)
    n = steps.shape[0]
    middle = fine.shape[0] // 2
    last = fine.shape[0]
    width = 2 * int(np.ceil(reach[0])) + 1
    values = np.zeros((m, width), np.float32)
    first = np.empty(m, np.int32)
    for p in range(m):
        u, v = cells[p, 0], cells[p, 1]
        j0 = min(max(int(np.floor(u - reach[0])), 0), n)
        i0, i1 = max(int(v - reach[1]), 0), min(int(v + reach[1]) + 1, n)
        first[p] = j0
        for j in range(j0, min(j0 + width, n + 1)):
            # the line's points in samples of `fine`, rounded by the half that is added
            x = scale[0, 0] * (u - j) + scale[0, 1] * (v - i0 - 0.5 / pieces) + middle + 0.5
            y = scale[1, 0] * (u - j) + scale[1, 1] * (v - i0 - 0.5 / pieces) + middle + 0.5
            total = np.float32(0)
            for i in range(i0, i1):
                for _ in range(pieces):
                    if x >= 0 and y >= 0 and x < last and y < last:
                        total += steps[i, j] * fine[int(y), int(x)]
                    x -= scale[0, 1] / pieces
                    y -= scale[1, 1] / pieces
            values[p, j - j0] = total * weight[p] / pieces
    return values, first
