"""The linear system of the PSF, its nuisance parameters eliminated, solved freely, clipped or non-negative."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt
import scipy.linalg

from procedures.numerics.solvers import non_negative_least_squares
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


def eliminate(AA: Array, A: Array32, Z: Array, r: Array) -> NormalEquations:
    """Normal equations of min |A h + Z t - r| for h alone, t eliminated.

    Parameters
    ----------
    AA : (n, n) float64
        A'A, or that of a matrix near A when h is an increment.
    A : (m, n) float32, Z : (m, p) float64, r : (m,) float64
        All with their rows scaled by one over the noise.
    """
    AZr = A.T @ np.column_stack([Z, r]).astype(np.float32)
    AZ, Ar = AZr[:, :-1].astype(np.float64), AZr[:, -1].astype(np.float64)
    ZZ, Zr = Z.T @ Z, Z.T @ r
    X = np.linalg.solve(ZZ, np.column_stack([AZ.T, Zr]))
    return NormalEquations(AA - AZ @ X[:, :-1], Ar - AZ @ X[:, -1], AZ, ZZ, Zr)


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
    h = scipy.linalg.solve(G, b, assume_a="pos")
    return np.asarray(np.maximum(h, 0) if solver == "clip" else h)


def gamma(G: Array, mean_square_weight: float) -> float:
    """The noise amplification sqrt(sum 1 / sigma_i^2) of the system: |dh| = gamma sigma for noise sigma.

    Parameters
    ----------
    G : (n, n) float64
        Normal matrix of the weighted system.
    mean_square_weight : float
        Mean of the squared weights, which takes the weights' scale out again.

    Notes
    -----
    The nuisance parameters are eliminated from G: what they cost is included. Source: thesis, section 2.3.1, whose
    gamma is this one squared.
    """
    return float(np.sqrt(np.trace(scipy.linalg.inv(G)) * mean_square_weight))


def gamma_bound(m: int, n: int) -> float:
    """Smallest gamma of any chart with values in [0, 1], m samples and n PSF values.

    Source: thesis, Proposition 1 with a = 0, b = 1, its square root taken as in `gamma`.
    """
    return float(np.sqrt((1 + 4 * (n - 1) ** 2) / (m * n)))


def normalised(h: Array, covariance: Array) -> tuple[Array, Array]:
    """The PSF (n,) of sum 1 and its covariance (n, n), to first order."""
    total = h.sum()
    h = h / total
    J = (np.eye(len(h)) - h[:, None]) / total
    return h, J @ covariance @ J.T
