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
from scipy.special import sici

from procedures.numerics.sampled_convolution import sample_convolution
from procedures.pattern import BLOCK, BLOCKS, CELLS, Chart
from procedures.pattern_psf.gamma import gamma_bound
from procedures.pattern_psf.rasterise import whole_chart

Array = npt.NDArray[np.float64]
Array32 = npt.NDArray[np.float32]

RATIOS = (0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.7)
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


def frontal_system(chart: Chart, s: int, k: int, s_over_t: float, pixels: int) -> Array32:
    """S_s C[u] of one chart seen squarely, for a square of pixels at its middle: (pixels^2, k^2) float32.

    Every cell is cut to the s grid's band exactly, by the integral of the sinc over it. Source: thesis, section 2.3.3.
    """
    side = s * (pixels - 1) + k
    across = _cells_on_grid(side, s_over_t)
    dark = 1 - whole_chart(chart).astype(np.float64)  # white goes on for ever around the chart
    u = (1 - across @ dark @ across.T).astype(np.float32)
    rows, columns = (place.ravel() for place in np.mgrid[:pixels, :pixels])
    return np.asarray(sample_convolution(u, rows, columns, np.ones(pixels**2, dtype=np.float32), s, k))


def _cells_on_grid(side: int, cell: float) -> Array:
    """What each of the chart's columns of cells adds to samples about its middle, (side, 320); `cell` in samples."""
    samples = np.arange(side)[:, None] - (side - 1) / 2
    edges = (np.arange(BLOCK * BLOCKS + 1) - BLOCK * BLOCKS / 2) * cell
    integral = sici(np.pi * (samples - edges))[0] / np.pi
    return np.asarray(integral[:, :-1] - integral[:, 1:])
