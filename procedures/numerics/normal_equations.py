"""Normal equations of a linear system whose nuisance parameters are eliminated."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from procedures.numerics.arrays import Array, Array32
from procedures.numerics.solvers import cholesky_inverse, cholesky_solve
from procedures.numerics.triangular import inverse_lower, solve_factored


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
        """Move the last nuisance columns to A, as its last columns.

        count : number of columns; precision, pull : (c,) prior of the last c of them, as in `with_prior`.
        """
        joined, others = self.AZ[:, -count:], self.AZ[:, :-count]
        block, right = self.ZZ[-count:, -count:].copy(), self.Zr[-count:].copy()
        last = np.arange(count - len(precision), count)
        block[last, last] += precision
        right[last] += precision * pull
        return Products(
            np.block([[self.AA, joined], [joined.T, block]]),
            np.vstack([others, self.ZZ[-count:, :-count]]),
            self.ZZ[:-count, :-count],
            np.concatenate([self.Ar, right]),
            self.Zr[:-count],
        )


def products(AA: Array, A: Array32, Z: Array, r: Array) -> Products:
    """Products of A (m, n) float32, nuisance columns Z (m, p) and r (m,), all rows divided by the noise."""
    AZr = (A.T @ np.column_stack([Z, r]).astype(np.float32)).astype(np.float64)
    return Products(AA, AZr[:, :-1], Z.T @ Z, AZr[:, -1], Z.T @ r)


def products_within(whole: Array32, n: int, Z: Array, r: Array) -> Products:
    """`products` for A the first n columns of a matrix (m, n + p + 1); the other columns are overwritten.

    One matrix product takes little longer than A'A alone; Z'Z and Z'r stay in double precision.
    """
    whole[:, n:-1], whole[:, -1] = Z, r
    G = gram(whole)
    return Products(G[:n, :n], G[:n, n:-1], Z.T @ Z, G[:n, -1], Z.T @ r)


def eliminate(p: Products) -> NormalEquations:
    """Normal equations of min |A h + Z t - r| for h alone, t eliminated.

    Raises numpy.linalg.LinAlgError if A and Z do not determine h and t.
    """
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
