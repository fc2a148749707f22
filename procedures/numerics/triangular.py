"""Triangular systems without SciPy, whose linear algebra takes longer to import than this takes to run."""

from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.numerics import loops

Matrix = npt.NDArray[np.floating[Any]]

BLOCK = 48
"""Rows solved at once; the blocks next to them are matrix products."""
LEAF = 80
"""Size up to which a matrix is inverted row by row; NumPy's general inverse takes several times as long there."""


def solve_factored(L: Matrix, b: Matrix) -> Matrix:
    """Solution x of L L' x = b for lower triangular L (n, n) and b (n,) or (n, p)."""
    if b.ndim == 1:
        return loops.substituted(np.ascontiguousarray(L), b.astype(L.dtype))
    return _solve_upper(L.T, solve_lower(L, b))


def solve_lower(L: Matrix, b: Matrix) -> Matrix:
    """Solution x of L x = b for lower triangular L (n, n) and b (n,) or (n, p)."""
    x = np.array(b, dtype=np.result_type(L, b))
    for i in range(0, len(L), BLOCK):
        rows = slice(i, i + BLOCK)
        x[rows] = np.linalg.solve(L[rows, rows], x[rows] - L[rows, :i] @ x[:i])
    return x


def _solve_upper(U: Matrix, b: Matrix) -> Matrix:
    x = np.array(b, dtype=np.result_type(U, b))
    for i in reversed(range(0, len(U), BLOCK)):
        rows, below = slice(i, i + BLOCK), slice(i + BLOCK, None)
        x[rows] = np.linalg.solve(U[rows, rows], x[rows] - U[rows, below] @ x[below])
    return x


def inverse_lower(L: Matrix) -> Matrix:
    """Inverse of a lower triangular matrix, by recursion on its halves."""
    n = len(L)
    if n <= LEAF:
        return loops.inverted(np.ascontiguousarray(L))
    half = n // 2
    inverse = np.zeros_like(L)
    inverse[:half, :half], inverse[half:, half:] = inverse_lower(L[:half, :half]), inverse_lower(L[half:, half:])
    inverse[half:, :half] = -inverse[half:, half:] @ (L[half:, :half] @ inverse[:half, :half])
    return inverse
