"""Normal equations of a linear system whose nuisance parameters are eliminated."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from procedures.numerics.solvers import cholesky_solve

Array = npt.NDArray[np.float64]
Array32 = npt.NDArray[np.float32]


@dataclass(frozen=True)
class NormalEquations:
    """Gram matrix and right-hand side of the kernel h with the nuisance columns Z projected out.

    Attributes
    ----------
    G : (n, n) float64
        A'A - A'Z (Z'Z)^-1 Z'A: the inverse is the covariance of h for unit noise, nuisance parameters included.
    b : (n,) float64
        A'r - A'Z (Z'Z)^-1 Z'r.
    AZ : (n, p), ZZ : (p, p), Zr : (p,)
        What gives the nuisance parameters back.
    """

    G: Array
    b: Array
    AZ: Array
    ZZ: Array
    Zr: Array

    def nuisance(self, h: Array) -> Array:
        """The nuisance parameters (p,) that go with the kernel h (n,)."""
        return np.asarray(np.linalg.solve(self.ZZ, self.Zr - self.AZ.T @ h))

    def response(self, change: Array) -> Array:
        """How the nuisance parameters (p,) follow a change of the kernel (n,)."""
        return np.asarray(-np.linalg.solve(self.ZZ, self.AZ.T @ change))


def gram(A: Array32) -> Array:
    """A'A in double precision; the sum itself runs in the matrix's single precision."""
    return np.asarray(A.T @ A, dtype=np.float64)


@dataclass(frozen=True)
class Products:
    """What the normal equations are made of.

    Attributes
    ----------
    AA : (n, n) float64
        A'A, or that of a matrix near A when h is an increment.
    AZ : (n, p), ZZ : (p, p), Ar : (n,), Zr : (p,)
        A'Z, Z'Z, A'r, Z'r.
    pull : (p,) float64 or 0
        The part of Zr that is no product, but known beforehand.
    """

    AA: Array
    AZ: Array
    ZZ: Array
    Ar: Array
    Zr: Array
    pull: Array | float = 0.0

    def with_right_side(self, A: Array32, Z: Array, r: Array) -> Products:
        """The same for another r (m,)."""
        return replace(self, Ar=(A.T @ r.astype(np.float32)).astype(np.float64), Zr=Z.T @ r + self.pull)

    def with_prior(self, precision: Array, pull: Array) -> Products:
        """The same with what is known of the nuisance parameters beforehand.

        Parameters
        ----------
        precision : (p,) float64
            One over the variance of each, in units where the data's noise is 1; 0 where nothing is known.
        pull : (p,) float64
            What they are expected to become: the mean known less the present value.
        """
        return replace(
            self, ZZ=self.ZZ + np.diag(precision), Zr=self.Zr + precision * pull, pull=self.pull + precision * pull
        )

    def with_kept(self, count: int, precision: Array, pull: Array) -> Products:
        """The same with the last nuisance columns counted to A, as its last columns.

        Parameters
        ----------
        count : int
            How many columns.
        precision, pull : (c,) float64
            What is known beforehand of the last c of them, as in `with_prior`.
        """
        kept, others = self.AZ[:, -count:], self.AZ[:, :-count]
        own, known = self.ZZ[-count:, -count:].copy(), self.Zr[-count:].copy()
        last = np.arange(count - len(precision), count)
        own[last, last] += precision
        known[last] += precision * pull
        return Products(
            np.block([[self.AA, kept], [kept.T, own]]),
            np.vstack([others, self.ZZ[-count:, :-count]]),
            self.ZZ[:-count, :-count],
            np.concatenate([self.Ar, known]),
            self.Zr[:-count],
        )


def products(AA: Array, A: Array32, Z: Array, r: Array) -> Products:
    """The products of A (m, n) float32, nuisance columns Z (m, p) and r (m,), their rows over the noise."""
    AZr = (A.T @ np.column_stack([Z, r]).astype(np.float32)).astype(np.float64)
    return Products(AA, AZr[:, :-1], Z.T @ Z, AZr[:, -1], Z.T @ r)


def eliminate(p: Products) -> NormalEquations:
    """Normal equations of min |A h + Z t - r| for h alone, t eliminated."""
    X = cholesky_solve(p.ZZ, np.column_stack([p.AZ.T, p.Zr]))
    return NormalEquations(p.AA - p.AZ @ X[:, :-1], p.Ar - p.AZ @ X[:, -1], p.AZ, p.ZZ, p.Zr)


def normalised(h: Array, covariance: Array) -> tuple[Array, Array]:
    """The kernel (n,) of sum 1 and its covariance (n, n), to first order."""
    total = h.sum()
    h = h / total
    # J C J' with J = (I - h 1') / total
    covariance = covariance - h[:, None] * covariance.sum(axis=0)
    covariance = covariance - covariance.sum(axis=1)[:, None] * h
    return h, covariance / total**2
