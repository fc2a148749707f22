"""gamma against s/t: what the distance of the noise chart does to the noise of the PSF.

The chart is seen squarely, whole, by an ideal sensor: no lens is in it, since gamma belongs to the chart on the s grid,
cut to the frequencies that this grid holds. Nearer than s/t = 1 more samples see the noise region, and the chart's own
spectrum falls, to zero at the band's edge for s/t = 2; farther away the cells blur into grey.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.linalg

from procedures.pattern import CELLS
from procedures.pattern_psf.gamma.amplification import gamma_bound

Array = npt.NDArray[np.float64]

RATIOS = (0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.7, 1.8, 1.9)
"""Where the curve is drawn."""
NODES = 200
"""Of the quadrature over the band: the spectra turn over some ten times in it at most."""


@dataclass(frozen=True)
class View:
    """The noise region seen squarely.

    Attributes
    ----------
    s_over_t : float
        Samples of the PSF per cell of the chart.
    pixels : int
        Of the plane, along one side.
    gamma, bound : float
        Of this view, and of the best chart that as many pixels could see.
    """

    s_over_t: float
    pixels: int
    gamma: float
    bound: float


def gamma_curve(s: int, k: int, ratios: tuple[float, ...] = RATIOS) -> tuple[View, ...]:
    """gamma over s/t of random cells, the whole noise region in sight, where its pixels determine the PSF.

    That of a single chart lies within some per cent, most at the far end.
    """
    views = []
    for ratio in ratios:
        pixels = int(CELLS * ratio / s + 1e-9)
        if pixels > 1.2 * k:
            m = pixels**2
            views.append(View(ratio, pixels, expected_gamma(ratio, k, m), gamma_bound(m, k * k)))
    return tuple(views)


def expected_gamma(s_over_t: float, k: int, m: int) -> float:
    """gamma of m samples of random cells, half of them white, each s/t samples wide, for k x k PSF values.

    The expected A'A of stationary noise is m (C x C / 4 + 1 1' / 4), C (k, k) the covariance of cells along one axis
    cut to the band. The inverse of a sum of m products is larger than that of its mean by m / (m - k^2 - 1), were the
    samples independent. Source: thesis, section 2.3.2, whose cells are one sample wide and not cut.
    """
    inverse = scipy.linalg.inv(scipy.linalg.toeplitz(_covariance(s_over_t, k)))
    level = inverse.sum(axis=0)
    spread = 4 * float(np.trace(inverse)) ** 2
    known_better = 4 * float(level @ level) ** 2 / (1 + float(level.sum()) ** 2)
    return (spread - known_better) / (m - k * k - 1)


def _covariance(cell: float, k: int) -> Array:
    """Covariance (k,) over whole samples of a line of independent cells of variance 1, cut to the samples' band."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    f, df = nodes / 2, weights / 2  # cycles per sample
    power = cell * np.sinc(cell * f) ** 2
    return np.asarray(np.cos(2 * np.pi * np.arange(k)[:, None] * f) @ (power * df))
