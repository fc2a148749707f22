"""The noise of the near photograph: what it does to least squares, and the kernel without that.

The matrix A holds the near photograph, noise and all: A = A0 + E. On the s grid, band-limited to it, the near pixels'
noise stays white, of variance c sigma^2 with c = s^2 / det J: the share of the near photograph's band that is kept.
Each row of A holds k^2 different samples, so that E'E is m c sigma^2 D on average, D the identity; the tail's columns
hold means of others, and D there the products of their kernels. Least squares therefore solves
(A0'A0 + m c sigma^2 D) k = A0'y and shrinks the kernel where the wall's spectrum is weak; taking m c sigma^2 D off
again leaves no bias, to first order. sigma itself comes from the residual, whose variance is sigma^2 (1 + c |k|^2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.linalg

from procedures.numerics.kernel_tail import tail_kernels
from procedures.numerics.solvers import cholesky_solve
from procedures.numerics.warps import inverse
from procedures.outcome import Refused
from procedures.two_photo.inter_image import TAIL, PairFit
from procedures.two_photo.recursion import gain_of

Array = npt.NDArray[np.float64]
Array32 = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Kernel:
    """The inter-image kernel, free of the near photograph's noise.

    Attributes
    ----------
    total : (n + q,) float64
        The kernel's samples and, last, its tail's amplitudes.
    covariance : (n + q, n + q) float64
        Noise of both photographs, and the nuisance parameters.
    noise : float
        sigma, in the units of the samples.
    bias : float
        |k - plain least squares| / |k|.
    inverse : (n + q, n + q) float64
        Of the equations without the near photograph's noise.
    given_back : (n + q,) float64
        What taking that noise off adds to the equations' right-hand side.
    """

    total: Array
    covariance: Array
    noise: float
    bias: float
    inverse: Array
    given_back: Array

    @property
    def k(self) -> Array:
        """The kernel inside its support, (n,)."""
        return self.total[:-TAIL]

    @property
    def gain(self) -> float:
        """Contrast of the far photograph over the near one's."""
        return gain_of(self.total)

    @property
    def cut(self) -> float:
        """Share of the kernel beyond its support."""
        return 1 - float(self.k.sum()) / self.gain


def without_near_noise(fit: PairFit, near_noise_limit: float) -> Kernel:
    """The kernel with the bias that the near photograph's noise gives least squares taken out.

    Parameters
    ----------
    fit : PairFit
    near_noise_limit : float
        Upper limit of the near pixels' noise: what the residual holds beyond it is not noise of a pixel.

    Raises
    ------
    Refused
        If the near photograph has more noise than texture at some of the frequencies.

    Notes
    -----
    With r = y - A k the corrected equations' right-hand side has the covariance var(r) (A0'A0 + m c sigma^2 I): the
    near noise enters a second time, multiplied by the residual.
    """
    G = fit.equations.G
    plain = np.concatenate([fit.kernel, fit.tail])
    shapes = tail_kernels(round(len(fit.kernel) ** 0.5))
    D = scipy.linalg.block_diag(np.eye(len(fit.kernel)), np.tensordot(shapes, shapes, axes=((1, 2), (1, 2))))
    c = fit.near.s**2 / float(np.linalg.det(fit.scale()))
    noise = float(np.sqrt(fit.variance / (1 + c * float(fit.kernel @ fit.kernel))))
    taken_off = len(fit.residual) * c * min(noise, near_noise_limit) ** 2 * D
    corrected = G - taken_off
    try:
        total = cholesky_solve(corrected, G @ plain)
    except np.linalg.LinAlgError as error:
        raise Refused(
            f"the near photograph's noise must stay under the wall's texture at all frequencies that s = {fit.near.s} "
            "asks for; it does not",
            "choose a rougher wall with fine detail, expose longer, focus the near photograph, or lower s",
        ) from error
    inverted = inverse(corrected)
    bias = float(np.linalg.norm(total - plain) / np.linalg.norm(total))
    return Kernel(total, fit.variance * inverted @ G @ inverted, noise, bias, inverted, taken_off @ total)


def noise_at_most(samples: Array32) -> float:
    """An upper limit of the pixels' noise: the median size of the second difference along both axes.

    Texture can only add to it. The difference of noise sigma has the standard deviation 6 sigma; one pixel in nine
    is asked.
    """
    rows, columns = (n // 3 * 3 for n in samples.shape)
    squares = samples[:rows, :columns].reshape(rows // 3, 3, columns // 3, 3)
    difference = np.array([1, -2, 1], dtype=np.float32)
    both = np.einsum("iajb,a,b->ij", squares, difference, difference, optimize=True)
    return float(1.4826 * np.median(np.abs(both)) / 6)
