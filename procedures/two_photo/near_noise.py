"""Correction of the kernel for the noise of the near photograph.

The matrix A contains the near photograph with its noise: A = A0 + E. On the s grid, band-limited to it, the near
pixels' noise is white, of variance c sigma^2 with c = s^2 / det J, the retained share of the near photograph's band.
Each row of A contains k^2 different samples, so that the mean of E'E is m c sigma^2 D, D the identity; the tail's
columns contain means of other samples, and D the products of their kernels. Least squares therefore solves
(A0'A0 + m c sigma^2 D) k = A0'y and shrinks the kernel where the wall's spectrum is weak; subtracting m c sigma^2 D
removes the bias to first order. sigma derives from the residual, whose variance is sigma^2 (1 + c |k|^2).
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from procedures.numerics.arrays import Array, Array32
from procedures.numerics.kernel_tail import tail_kernels
from procedures.numerics.normal_equations import cholesky_solve
from procedures.numerics.warps import inverse
from procedures.outcome import Refused
from procedures.two_photo.inter_image import TAIL, PairFit
from procedures.two_photo.recursion import gain_of


@dataclass(frozen=True)
class InterImageKernel:
    """The inter-image kernel, corrected for the near photograph's noise.

    total : (n + q,), samples of the kernel, and amplitudes of its tail
    covariance : (n + q, n + q), by the noise of both photographs, including nuisance parameters
    noise : sigma, in the unit of the samples
    bias : |k - plain least squares| / |k|
    inverse : (n + q, n + q), inverse of the corrected normal equations
    noise_correction : (n + q,), change of the equations' right-hand side by the correction
    """

    total: Array
    covariance: Array
    noise: float
    bias: float
    inverse: Array
    noise_correction: Array

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


def without_near_noise(fit: PairFit, near_noise_limit: float) -> InterImageKernel:
    """The kernel corrected for the bias of least squares due to the near photograph's noise.

    Raises Refused if the near photograph has more noise than texture at some of the frequencies.

    near_noise_limit : upper limit of the near pixels' noise: a larger residual is not pixel noise

    With r = y - A k the corrected equations' right-hand side has the covariance var(r) (A0'A0 + m c sigma^2 I): the
    near noise enters a second time, multiplied by the residual.
    """
    G = fit.equations.G
    plain = np.concatenate([fit.kernel, fit.tail])
    shapes = tail_kernels(round(len(fit.kernel) ** 0.5))
    D = scipy.linalg.block_diag(np.eye(len(fit.kernel)), np.tensordot(shapes, shapes, axes=((1, 2), (1, 2))))
    c = fit.near.s**2 / float(np.linalg.det(fit.scale()))
    noise = float(np.sqrt(fit.variance / (1 + c * float(fit.kernel @ fit.kernel))))
    correction = len(fit.residual) * c * min(noise, near_noise_limit) ** 2 * D
    corrected = G - correction
    try:
        total = cholesky_solve(corrected, G @ plain)
    except np.linalg.LinAlgError as error:
        raise Refused(
            f"the near photograph's noise must stay under the wall's texture at all frequencies that s = {fit.near.s} "
            "requires; it does not",
            "choose a rougher wall with fine detail, expose longer, focus the near photograph, or lower s",
        ) from error
    inverted = inverse(corrected)
    bias = float(np.linalg.norm(total - plain) / np.linalg.norm(total))
    return InterImageKernel(total, fit.variance * inverted @ G @ inverted, noise, bias, inverted, correction @ total)


def noise_at_most(samples: Array32) -> float:
    """An upper limit of the pixels' noise: the median magnitude of the second difference along both axes.

    Texture can only increase it. Noise sigma gives a standard deviation of 6 sigma; one pixel in nine is used.
    """
    rows, columns = (n // 3 * 3 for n in samples.shape)
    squares = samples[:rows, :columns].reshape(rows // 3, 3, columns // 3, 3)
    difference = np.array([1, -2, 1], dtype=np.float32)
    both = np.einsum("iajb,a,b->ij", squares, difference, difference, optimize=True)
    return float(1.4826 * np.median(np.abs(both)) / 6)
