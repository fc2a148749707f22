"""Solvers of small dense problems given by their normal equations."""

from __future__ import annotations

import numpy as np

from procedures.numerics.arrays import Array
from procedures.numerics.triangular import inverse_lower, solve_factored

SOLVERS = ("ls", "clip", "nnls")
MOST_EXCHANGES = 200


def cholesky_solve(G: Array, b: Array) -> Array:
    """Solution x of G x = b for symmetric positive definite G (n, n) and b (n,) or (n, p).

    Raises numpy.linalg.LinAlgError if G is not positive definite.
    """
    return np.asarray(solve_factored(np.linalg.cholesky(G), b), dtype=np.float64)


def cholesky_inverse(G: Array) -> Array:
    """The inverse of a symmetric positive definite matrix.

    Raises numpy.linalg.LinAlgError if G is not positive definite.
    """
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
    """The kernel (n,) from its normal equations: "ls" unconstrained, "clip" with negatives set to 0, "nnls" >= 0.

    Raises ValueError if the solver is unknown.

    Source: Delbracio, Muse, Almansa, IPOL 2012, section 4.8.
    """
    if solver not in SOLVERS:
        raise ValueError(f"the solver is one of {', '.join(SOLVERS)}; got {solver!r}")
    if solver == "nnls":
        return non_negative_least_squares(G, b)
    h = cholesky_solve(G, b)
    return np.maximum(h, 0) if solver == "clip" else h
