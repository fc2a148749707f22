"""Reference methods with which the papers compare theirs."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from procedures.numerics.solvers import solve_constrained

Array = npt.NDArray[np.float64]


def joshi(A: Array, v: Array, k: int, weight: float) -> Array:
    """The non-negative kernel (k, k) that minimises ||A h - v||^2 + weight ||grad h||^2.

    Parameters
    ----------
    A : (m, k^2)
        The known pattern as a convolution, sampled at the pixels.
    v : (m,)
        The photograph.
    weight : float
        In units of the mean diagonal element of A'A; without it the equations of step edges are singular.

    References
    ----------
    Joshi, Szeliski, Kriegman, PSF Estimation using Sharp Edge Prediction, CVPR 2008, equation 6.
    """
    G = A.T @ A
    smoothed = G + weight * float(np.mean(np.diag(G))) * gradient_energy(k)
    return solve_constrained(smoothed, A.T @ v, "nnls").reshape(k, k)


def gradient_energy(k: int) -> Array:
    """L with h' L h the sum of squared differences of neighbours in a (k, k) picture padded by zeros."""
    second = 2 * np.eye(k) - np.eye(k, k=1) - np.eye(k, k=-1)
    return np.kron(second, np.eye(k)) + np.kron(np.eye(k), second)


def least_squares(A: Array, v: Array, k: int) -> Array:
    """The kernel (k, k) that minimises ||A h - v||^2: the thesis's method, equation (P)."""
    return solve_constrained(A.T @ A, A.T @ v, "ls").reshape(k, k)


def psnr_db(h: Array, truth: Array) -> float:
    """Peak signal-to-noise ratio of a kernel with respect to the true one."""
    return float(10 * np.log10(truth.max() ** 2 / np.mean((h - truth) ** 2)))
