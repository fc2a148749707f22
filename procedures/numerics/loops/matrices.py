"""Matrices of sampled convolutions, and triangular systems."""

from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.numerics.arrays import Array32
from procedures.numerics.compiled import compiled, vectorised

Matrix = npt.NDArray[np.floating[Any]]


@compiled
def fill_convolution(
    A: Array32, raster: Array32, rows: npt.NDArray[np.int64], columns: npt.NDArray[np.int64], weight: Array32, s: int,
    k: int,
) -> None:  # fmt: skip
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
) -> Array32:
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
def sums_of_groups(A: Array32, group: npt.NDArray[np.int64], factor: Array32, count: int) -> Array32:
    """Sums over groups of a matrix' rows (m, n), each times its factor (m,): (count, n)."""
    out = np.zeros((count, A.shape[1]), np.float32)
    for p in range(len(A)):
        total, row, f = out[group[p]], A[p], factor[p]
        for j in range(len(row)):
            total[j] += f * row[j]
    return out


@vectorised
def substituted(L: Matrix, b: Matrix) -> Matrix:
    """`solve_factored` for one column, element by element; both in one precision."""
    x = b.copy()
    for i in range(len(L)):
        row, total = L[i], x[i]
        for j in range(i):
            total -= row[j] * x[j]
        x[i] = total / row[i]
    for i in range(len(L) - 1, -1, -1):
        row = L[i]
        x[i] /= row[i]
        for j in range(i):
            x[j] -= row[j] * x[i]
    return x


@vectorised
def inverted(L: Matrix) -> Matrix:
    """Inverse of a lower triangular matrix, row by row."""
    X = np.zeros_like(L)
    for i in range(len(L)):
        row = X[i]
        for m in range(i):
            factor, above = L[i, m], X[m]
            for j in range(m + 1):
                row[j] -= factor * above[j]
        for j in range(i):
            row[j] /= L[i, i]
        row[i] = 1 / L[i, i]
    return X
