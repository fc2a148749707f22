"""How much a photograph amplifies its noise, and how little any photograph could."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


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
