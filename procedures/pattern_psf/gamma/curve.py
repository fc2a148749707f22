"""gamma as a function of s/t: effect of the chart's distance on the noise of the PSF.

The whole chart is imaged squarely by an ideal sensor. No lens is included, since gamma is defined for the chart on the
s grid, band-limited to it. Closer than s/t = 1 more samples cover the noise region, and the chart's spectrum falls, to
zero at the band's edge for s/t = 2; farther away the cells average to grey.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from procedures.numerics.arrays import Array
from procedures.pattern import CELLS
from procedures.pattern_psf.gamma.amplification import gamma_bound

RATIOS = (0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.7, 1.8, 1.9)
"""Sampling ratios of the curve."""
NODES = 200
"""Nodes of the quadrature over the band, in which the spectra oscillate about ten times at most."""


@dataclass(frozen=True)
class NoiseRegionView:
    """Square view of the noise region.

    Attributes
    ----------
    s_over_t : samples of the PSF per cell of the chart
    pixels : pixels of the plane along one side
    gamma, bound : gamma of this view, and its lower bound for as many pixels
    """

    s_over_t: float
    pixels: int
    gamma: float
    bound: float


def gamma_curve(s: int, k: int, ratios: tuple[float, ...] = RATIOS) -> tuple[NoiseRegionView, ...]:
    """Expected gamma over s/t for random cells and the whole noise region, where its pixels determine the PSF.

    That of a single chart differs by a few per cent, most at the far end.
    """
    views = []
    for ratio in ratios:
        pixels = int(CELLS * ratio / s + 1e-9)
        if pixels > 1.2 * k:
            m = pixels**2
            views.append(NoiseRegionView(ratio, pixels, expected_gamma(ratio, k, m), gamma_bound(m, k * k)))
    return tuple(views)


def expected_gamma(s_over_t: float, k: int, m: int) -> float:
    """Expected gamma of m samples of random cells, half of them white, each s/t samples wide, for k x k PSF values.

    The expected A'A of stationary noise is m (C x C / 4 + 1 1' / 4), C (k, k) the covariance of cells along one axis
    limited to the band. The inverse of a sum of m products is larger than that of its mean by m / (m - k^2 - 1) for
    independent samples. Source: thesis, section 2.3.2, whose cells are one sample wide and not band-limited.
    """
    inverse = scipy.linalg.inv(scipy.linalg.toeplitz(_covariance(s_over_t, k)))
    level = inverse.sum(axis=0)
    spread = 4 * float(np.trace(inverse)) ** 2
    known_better = 4 * float(level @ level) ** 2 / (1 + float(level.sum()) ** 2)
    return (spread - known_better) / (m - k * k - 1)


def _covariance(cell: float, k: int) -> Array:
    """Covariance (k,) at whole samples of a line of independent cells of variance 1, limited to the samples' band."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    f, df = nodes / 2, weights / 2  # cycles per sample
    power = cell * np.sinc(cell * f) ** 2
    return np.asarray(np.cos(2 * np.pi * np.arange(k)[:, None] * f) @ (power * df))
