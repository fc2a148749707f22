"""The linear system of the PSF, its nuisance parameters eliminated, solved freely, clipped or non-negative."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numba
import numpy as np
import numpy.typing as npt

from procedures.numerics.solvers import cholesky_solve, non_negative_least_squares
from procedures.outcome import BadParameter

Array = npt.NDArray[np.float64]
Array32 = npt.NDArray[np.float32]

SOLVERS = ("ls", "clip", "nnls")


@numba.njit(cache=True, nogil=True)
def sample_convolution(
    raster: Array32, rows: npt.NDArray[np.int64], columns: npt.NDArray[np.int64], weight: Array32, s: int, k: int
) -> Array32:  # pragma: no cover - compiled
    """The matrix S_s U: convolution with a raster, sampled at pixels, each row scaled by its weight.

    Parameters
    ----------
    raster : (s (rows - 1) + k, s (columns - 1) + k) float32
        The chart on the s grid with a border of k // 2 samples.
    rows, columns : (m,) int64
        The pixels.
    weight : (m,) float32
        One over the standard deviation of the pixel's sample.

    Returns
    -------
    (m, k^2) float32

    References
    ----------
    Delbracio, Muse, Almansa, IPOL 2012, section 4.7.
    """
    m = len(rows)
    A = np.empty((m, k * k), np.float32)
    for p in range(m):
        top, left, w = s * rows[p], s * columns[p], weight[p]
        for i in range(k):
            line = raster[top + k - 1 - i]
            for j in range(k):
                A[p, i * k + j] = w * line[left + k - 1 - j]
    return A


@numba.njit(cache=True, nogil=True, fastmath=True)
def convolve_at(
    raster: Array32, rows: npt.NDArray[np.int64], columns: npt.NDArray[np.int64], h: Array32, s: int
) -> Array32:  # pragma: no cover - compiled
    """A raster convolved with h (k, k), at pixels only: (m,) float32. Arguments as in `sample_convolution`."""
    m, k = len(rows), h.shape[0]
    out = np.empty(m, np.float32)
    for p in range(m):
        top, left = s * rows[p], s * columns[p]
        total = np.float32(0)
        for i in range(k):
            for j in range(k):
                total += h[i, j] * raster[top + k - 1 - i, left + k - 1 - j]
        out[p] = total
    return out


@dataclass(frozen=True)
class NormalEquations:
    """Gram matrix and right-hand side of the PSF with the nuisance columns Z projected out.

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
        """The nuisance parameters (p,) that go with the PSF h (n,)."""
        return np.asarray(np.linalg.solve(self.ZZ, self.Zr - self.AZ.T @ h))


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
    """

    AA: Array
    AZ: Array
    ZZ: Array
    Ar: Array
    Zr: Array

    def with_right_side(self, A: Array32, Z: Array, r: Array) -> Products:
        """The same for another r (m,)."""
        return replace(self, Ar=(A.T @ r.astype(np.float32)).astype(np.float64), Zr=Z.T @ r)


def products(AA: Array, A: Array32, Z: Array, r: Array) -> Products:
    """The products of A (m, n) float32, nuisance columns Z (m, p) and r (m,), their rows over the noise."""
    AZr = (A.T @ np.column_stack([Z, r]).astype(np.float32)).astype(np.float64)
    return Products(AA, AZr[:, :-1], Z.T @ Z, AZr[:, -1], Z.T @ r)


def eliminate(p: Products) -> NormalEquations:
    """Normal equations of min |A h + Z t - r| for h alone, t eliminated."""
    X = cholesky_solve(p.ZZ, np.column_stack([p.AZ.T, p.Zr]))
    return NormalEquations(p.AA - p.AZ @ X[:, :-1], p.Ar - p.AZ @ X[:, -1], p.AZ, p.ZZ, p.Zr)


def solve(G: Array, b: Array, solver: str) -> Array:
    """The PSF (n,) from its normal equations: "ls" freely, "clip" its negative part cut, "nnls" non-negative.

    References
    ----------
    Delbracio, Muse, Almansa, IPOL 2012, section 4.8.
    """
    if solver not in SOLVERS:
        raise BadParameter(f"the solver is one of {', '.join(SOLVERS)}; got {solver!r}", "choose one of them")
    if solver == "nnls":
        return non_negative_least_squares(G, b)
    h = cholesky_solve(G, b)
    return np.maximum(h, 0) if solver == "clip" else h


def gamma(unit_covariance: Array, mean_square_weight: float) -> float:
    """The noise amplification sqrt(sum 1 / sigma_i^2) of the system: |dh| = gamma sigma for noise sigma.

    Parameters
    ----------
    unit_covariance : (n, n) float64
        Covariance of the PSF of sum 1 when every weighted sample has unit noise.
    mean_square_weight : float
        Mean of the squared weights, which takes the weights' scale out again.

    Notes
    -----
    What the nuisance parameters cost is included. Source: thesis, section 2.3.1, whose gamma is this one squared.
    """
    return float(np.sqrt(np.trace(unit_covariance) * mean_square_weight))


def gamma_bound(m: int, n: int) -> float:
    """Smallest gamma of any chart with values in [0, 1], m samples and n PSF values.

    Source: thesis, Proposition 1 with a = 0, b = 1, its square root taken as in `gamma`.
    """
    return float(np.sqrt((1 + 4 * (n - 1) ** 2) / (m * n)))


def normalised(h: Array, covariance: Array) -> tuple[Array, Array]:
    """The PSF (n,) of sum 1 and its covariance (n, n), to first order."""
    total = h.sum()
    h = h / total
    # J C J' with J = (I - h 1') / total
    covariance = covariance - h[:, None] * covariance.sum(axis=0)
    covariance = covariance - covariance.sum(axis=1)[:, None] * h
    return h, covariance / total**2
