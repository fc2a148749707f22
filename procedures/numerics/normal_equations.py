"""Normal equations of a linear system whose nuisance parameters are eliminated."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.numerics import loops
from procedures.numerics.arrays import Array, Array32


@dataclass(frozen=True)
class NormalEquations:
    """Gram matrix and right-hand side of the kernel h with the nuisance columns Z projected out.

    G : (n, n) A'A - A'Z (Z'Z)^-1 Z'A: the inverse is the covariance of h for unit noise, nuisance parameters included
    b : (n,) A'r - A'Z (Z'Z)^-1 Z'r
    L : (n, n) Cholesky's factor of G
    AZ : (n, p), ZZ : (p, p) float64; A'Z and Z'Z
    E : (p, n) (Z'Z)^-1 Z'A: the decrease of the nuisance parameters per unit of the kernel
    t : (p,) (Z'Z)^-1 Z'r: the nuisance parameters without a kernel
    """

    G: Array
    b: Array
    L: Array
    AZ: Array
    ZZ: Array
    E: Array
    t: Array

    @property
    def kernel(self) -> Array:
        """The solution h (n,)."""
        return np.asarray(solve_factored(self.L, self.b))

    @cached_property
    def inverse(self) -> Array:
        """G^-1 (n, n)."""
        inverse = inverse_lower(self.L)
        return np.asarray(inverse.T @ inverse)

    @cached_property
    def inverse_where_known(self) -> Array:
        """(A'A)^-1 (n, n): covariance of h for unit noise at known nuisance parameters."""
        through = self.inverse @ self.AZ  # A'A is G plus a matrix of rank p: Woodbury's identity
        return np.asarray(self.inverse - through @ cholesky_solve(self.ZZ + self.AZ.T @ through, through.T))

    def nuisance(self, h: Array) -> Array:
        """The nuisance parameters (p,) for the kernel h (n,)."""
        return np.asarray(self.t - self.E @ h)

    def response(self, change: Array) -> Array:
        """Change of the nuisance parameters (p,) with a change of the kernel (n,)."""
        return np.asarray(-self.E @ change)

    def with_right_side(self, p: Products) -> NormalEquations:
        """These equations with Ar and Zr of other products of the same matrices."""
        t = cholesky_solve(self.ZZ, p.Zr)
        return replace(self, b=p.Ar - self.AZ @ t, t=t)


def gram(A: Array32) -> Array:
    """A'A in double precision; the sum itself runs in the matrix's single precision."""
    return np.asarray(A.T @ A, dtype=np.float64)


@dataclass(frozen=True)
class Products:
    """Products from which the normal equations are formed.

    AA : (n, n) A'A, or that of a matrix near A when h is an increment
    AZ : (n, p), ZZ : (p, p), Ar : (n,), Zr : (p,) A'Z, Z'Z, A'r, Z'r
    pull : (p,) float64 or 0; prior part of Zr
    """

    AA: Array
    AZ: Array
    ZZ: Array
    Ar: Array
    Zr: Array
    pull: Array | float = 0.0

    def with_right_side(self, A: Array32, Z: Array, r: Array) -> Products:
        """These products for another r (m,)."""
        return replace(self, Ar=(A.T @ r.astype(np.float32)).astype(np.float64), Zr=Z.T @ r + self.pull)

    def with_prior(self, precision: Array, pull: Array) -> Products:
        """Add a Gaussian prior of the nuisance parameters.

        precision : (p,) one over the prior variance of each, in units where the data's noise is 1; 0 without prior
        pull : (p,) prior mean less the present value
        """
        return replace(
            self, ZZ=self.ZZ + np.diag(precision), Zr=self.Zr + precision * pull, pull=self.pull + precision * pull
        )

    def with_joined(self, count: int, precision: Array, pull: Array) -> Products:
        """Move the last nuisance columns to A, as its last columns, with the prior of the last c of them, as in
        `with_prior`."""
        joined, others = self.AZ[:, -count:], self.AZ[:, :-count]
        block, right = self.ZZ[-count:, -count:].copy(), self.Zr[-count:].copy()
        last = np.arange(count - len(precision), count)
        block[last, last] += precision
        right[last] += precision * pull
        return Products(
            np.block([[self.AA, joined], [joined.T, block]]), np.vstack([others, self.ZZ[-count:, :-count]]),
            self.ZZ[:-count, :-count], np.concatenate([self.Ar, right]), self.Zr[:-count],
        )  # fmt: skip


def products(AA: Array, A: Array32, Z: Array, r: Array) -> Products:
    """Products of A (m, n) float32, nuisance columns Z (m, p) and r (m,), all rows divided by the noise."""
    AZr = (A.T @ np.column_stack([Z, r]).astype(np.float32)).astype(np.float64)
    return Products(AA, AZr[:, :-1], Z.T @ Z, AZr[:, -1], Z.T @ r)


def products_within(whole: Array32, n: int, Z: Array, r: Array) -> Products:
    """`products` for A the first n columns of a matrix (m, n + p + 1), whose other columns are overwritten: one
    product, Z'Z and Z'r in double precision."""
    whole[:, n:-1], whole[:, -1] = Z, r
    G = gram(whole)
    return Products(G[:n, :n], G[:n, n:-1], Z.T @ Z, G[:n, -1], Z.T @ r)


def eliminate(p: Products) -> NormalEquations:
    """Normal equations of min |A h + Z t - r| for h alone. Raises numpy.linalg.LinAlgError if A and Z do not determine
    h and t."""
    inverse = cholesky_inverse(p.ZZ)
    E, t = inverse @ p.AZ.T, inverse @ p.Zr
    G = p.AA - p.AZ @ E
    L = np.asarray(np.linalg.cholesky(G), dtype=np.float64)
    return NormalEquations(G, p.Ar - p.AZ @ t, L, p.AZ, p.ZZ, E, t)


def normalised(h: Array, covariance: Array) -> tuple[Array, Array]:
    """The kernel (n,) of sum 1 and its covariance (n, n), to first order."""
    total = h.sum()
    h = h / total
    # J C J' with J = (I - h 1') / total
    covariance = covariance - h[:, None] * covariance.sum(axis=0)
    covariance = covariance - covariance.sum(axis=1)[:, None] * h
    return h, covariance / total**2


# --- Solvers of small dense problems given by their normal equations ---

SOLVERS = ("ls", "clip", "nnls")
MOST_EXCHANGES = 200


def cholesky_solve(G: Array, b: Array) -> Array:
    """Solution of G x = b for symmetric positive definite G. Raises numpy.linalg.LinAlgError if it is not."""
    return np.asarray(solve_factored(np.linalg.cholesky(G), b), dtype=np.float64)


def cholesky_inverse(G: Array) -> Array:
    """The inverse of a symmetric positive definite matrix. Raises numpy.linalg.LinAlgError if it is not."""
    inverse = inverse_lower(np.linalg.cholesky(G))
    return np.asarray(inverse.T @ inverse, dtype=np.float64)


def non_negative_least_squares(G: Array, b: Array) -> Array:
    """Minimise x'G x / 2 - b'x subject to x >= 0, by block principal pivoting.

    Whole blocks of variables are exchanged while that lowers the number of infeasible ones; when it stalls, single
    exchanges of the last infeasible variable guarantee termination. Raises numpy.linalg.LinAlgError if the pivots run
    out, as they can when G is numerically singular.

    G : (n, n) symmetric positive definite: A'A of the least squares problem
    b : (n,) A'v

    Source: Portugal, Judice, Vicente, Mathematics of Computation 63 (1994) 625-643.
    """
    n = len(b)
    passive = cholesky_solve(G, b) > 0
    tolerance = 1e-12 * np.abs(b).max()
    fewest, chances = n + 1, 3
    for _ in range(MOST_EXCHANGES):
        x = np.zeros(n)
        x[passive] = cholesky_solve(G[np.ix_(passive, passive)], b[passive])
        gradient = G @ x - b
        wrong = (passive & (x < 0)) | (~passive & (gradient < -tolerance))
        count = int(wrong.sum())
        if count == 0:
            return x
        if count < fewest:
            fewest, chances = count, 3
        elif chances > 0:
            chances -= 1
        else:
            last = np.flatnonzero(wrong)[-1]
            wrong = np.arange(n) == last
        passive = passive ^ wrong
    raise np.linalg.LinAlgError(f"no non-negative solution after {MOST_EXCHANGES} exchanges: the matrix is singular")


def solve_constrained(G: Array, b: Array, solver: str) -> Array:
    """The kernel from its normal equations: "ls", "clip" with negatives set to 0, or "nnls" (Delbracio, Muse, Almansa,
    IPOL 2012, 4.8). Raises ValueError for others."""
    if solver not in SOLVERS:
        raise ValueError(f"the solver is one of {', '.join(SOLVERS)}; got {solver!r}")
    if solver == "nnls":
        return non_negative_least_squares(G, b)
    h = cholesky_solve(G, b)
    return np.maximum(h, 0) if solver == "clip" else h


# --- Triangular systems without SciPy, whose linear algebra takes longer to import than this takes to run ---

Matrix = npt.NDArray[np.floating[Any]]

BLOCK = 48  # rows solved at once; the blocks next to them are matrix products
LEAF = 80  # size up to which a matrix is inverted row by row; NumPy's general inverse takes several times as long there


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
