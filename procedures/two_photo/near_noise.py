"""The noise of the near photograph: what it does to least squares, and the kernel without that.

The matrix A holds the near photograph, noise and all: A = A0 + E. On the s grid, band-limited to it, the near pixels'
noise stays white, of variance c sigma^2 with c = s^2 / det J: the share of the near photograph's band that is kept.
Each row of A holds k^2 different samples, so that E'E is m c sigma^2 I on average. Least squares therefore solves
(A0'A0 + m c sigma^2 I) k = A0'y and shrinks the kernel where the wall's spectrum is weak; taking m c sigma^2 I off
again leaves no bias, to first order. sigma itself comes from the residual, whose variance is sigma^2 (1 + c |k|^2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.numerics.solvers import cholesky_solve
from procedures.numerics.warps import inverse
from procedures.outcome import Refused
from procedures.two_photo.inter_image import Fit

Array = npt.NDArray[np.float64]
Array32 = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Kernel:
    """The inter-image kernel, free of the near photograph's noise.

    Attributes
    ----------
    k : (n,) float64
        Its sum is the gain from the near to the far photograph.
    covariance : (n, n) float64
        Noise of both photographs, and the nuisance parameters.
    information : (n, n) float64
        The normal matrix without the near noise's share.
    noise : float
        sigma, in the units of the samples.
    bias : float
        |k - plain least squares| / |k|.
    """

    k: Array
    covariance: Array
    information: Array
    noise: float
    bias: float


def without_near_noise(fit: Fit, near_noise_limit: float) -> Kernel:
    """The kernel with the bias that the near photograph's noise gives least squares taken out.

    Parameters
    ----------
    fit : Fit
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
    n, m = len(G), len(fit.residual)
    c = fit.near.s**2 / float(np.linalg.det(fit.scale()))
    noise = float(np.sqrt(fit.variance / (1 + c * float(fit.kernel @ fit.kernel))))
    corrected = G - m * c * min(noise, near_noise_limit) ** 2 * np.eye(n)
    try:
        k = cholesky_solve(corrected, G @ fit.kernel)
    except np.linalg.LinAlgError as error:
        raise Refused(
            f"the near photograph's noise must stay under the wall's texture at all frequencies that s = {fit.near.s} "
            "asks for; it does not",
            "choose a rougher wall with fine detail, expose longer, focus the near photograph, or lower s",
        ) from error
    inverted = inverse(corrected)
    bias = float(np.linalg.norm(k - fit.kernel) / np.linalg.norm(k))
    return Kernel(k, fit.variance * inverted @ G @ inverted, corrected, noise, bias)


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
