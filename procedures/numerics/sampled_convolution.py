"""Convolution of an image on the s grid, sampled at pixels: as a matrix, and applied."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from procedures.numerics.compiled import compiled, vectorised

Array32 = npt.NDArray[np.float32]

np.empty(31 << 20, np.uint8)
# The C library (glibc) keeps twice as much freed memory as the largest freed block of up to 32 MiB: after this one, the
# pages of a matrix are not returned to the system and cleared again for every PSF.


def sample_convolution(
    raster: Array32,
    rows: npt.NDArray[np.int64],
    columns: npt.NDArray[np.int64],
    weight: Array32,
    s: int,
    k: int,
    more: int = 0,
) -> Array32:
    """The matrix S_s U: convolution with a raster, sampled at pixels, each row scaled by its weight.

    Parameters
    ----------
    raster : (s (rows - 1) + k, s (columns - 1) + k) float32
        The image on the s grid, with a border of k // 2 samples.
    rows, columns : (m,) int64
        The pixels.
    weight : (m,) float32
        One over the standard deviation of the pixel's sample.
    more : int
        Additional columns, filled by the caller.

    Returns
    -------
    (m, k^2 + more) float32

    References
    ----------
    Delbracio, Muse, Almansa, IPOL 2012, section 4.7.
    """
    A = np.empty((len(rows), k * k + more), np.float32)  # NumPy allocates large pages
    _fill(A, raster, rows, columns, weight, s, k)
    return A


@compiled
def _fill(
    A: Array32,
    raster: Array32,
    rows: npt.NDArray[np.int64],
    columns: npt.NDArray[np.int64],
    weight: Array32,
    s: int,
    k: int,
) -> None:  # pragma: no cover - compiled
    """The first k^2 columns of `sample_convolution`."""
    for p in range(len(rows)):
        top, left, w = s * rows[p], s * columns[p], weight[p]
        for i in range(k):
            line = raster[top + k - 1 - i]
            for j in range(k):
                A[p, i * k + j] = w * line[left + k - 1 - j]


@vectorised
def convolve_at(
    raster: Array32, rows: npt.NDArray[np.int64], columns: npt.NDArray[np.int64], h: Array32, s: int
) -> Array32:  # pragma: no cover - compiled
    """A raster convolved with h (k, k), at pixels only: (m,) float32. Arguments as in `sample_convolution`."""
    m, k = len(rows), h.shape[0]
    out = np.empty(m, np.float32)
    flipped = np.ascontiguousarray(h[::-1, ::-1])  # both are then read forwards
    for p in range(m):
        top, left = s * rows[p], s * columns[p]
        total = np.float32(0)
        for i in range(k):
            line = raster[top + i]
            for j in range(k):
                total += flipped[i, j] * line[left + j]
        out[p] = total
    return out


@vectorised
def sums_of_groups(
    A: Array32, group: npt.NDArray[np.int64], factor: Array32, count: int
) -> Array32:  # pragma: no cover - compiled
    """Sums over groups of a matrix' rows (m, n), each times its factor (m,): (count, n)."""
    out = np.zeros((count, A.shape[1]), np.float32)
    for p in range(len(A)):
        total, row, f = out[group[p]], A[p], factor[p]
        for j in range(len(row)):
            total[j] += f * row[j]
    return out
