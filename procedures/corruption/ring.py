"""Detection of sharpening from the PSF: a ring around the core with less light than the far tail predicts.

Sharpening subtracts a blurred picture, which darkens a ring around the PSF's core. A lens cannot: beyond the core the
mean PSF falls to its tail a / r^3 from above, whatever the aberrations, and the tail is not negative.
"""

from itertools import pairwise

import numpy as np

from procedures.numerics.arrays import Array
from procedures.psf import Psf
from procedures.spatial_numbers import energy_within

RINGS_PX = (0.8, 1.2, 1.8, 2.7, 4.0, 6.0)
"""Radii of the rings; the outermost one ends with the support."""
LEAST_RATIO = 1.2
"""Least ratio of the radii of the outermost ring."""
MIN_TAIL_SHARE = 0.6
"""Least light of any lens between two radii, relative to that of the far tail."""
NARROW_BAND = 0.85
"""Share of the band with which the rings are computed again: a band that ends before the OTF causes rings of its own,
and half of the change counts as uncertainty."""


def missing_light(psf: Psf) -> float:
    """Light missing in the rings around the core, or in the tail, relative to any lens, in standard uncertainties; the
    tail beyond the support predicts 2 pi a (1 / r - 1 / R) between r and R. A steep decay, as of a Gaussian that the
    support cuts, makes a negative, although the light outside is not."""
    C, tail = psf.parameter_covariance, np.zeros(len(psf.parameters))
    if not len(psf.tail.amplitudes):
        return -np.inf
    tail[psf.k**2] = psf.tail_density_px / psf.tail.amplitudes[0] if psf.tail.amplitudes[0] else 0.0
    border = psf.k / 2 / psf.s
    radii = [radius for radius in RINGS_PX if radius <= border]
    radii += [border] if border > LEAST_RATIO * max(radii, default=border) else []
    within, narrow = [energy_within(psf, radius) for radius in radii], psf.narrowed(NARROW_BAND)
    band_errors = [(energy_within(narrow, radius)[0] - one) / 2 for radius, (one, _) in zip(radii, within, strict=True)]
    in_tail = _sigmas(-psf.tail_density_px, tail, C)
    missing = [in_tail if psf.share_outside < 0 else min(in_tail, 0.0)]
    rings = zip(pairwise(radii), pairwise(within), pairwise(band_errors), strict=True)
    for (r, R), ((inner, inner_slope), (outer, outer_slope)), (a, b) in rings:
        expected = MIN_TAIL_SHARE * 2 * np.pi * (1 / r - 1 / R)
        deficit = expected * max(psf.tail_density_px, 0.0) - (outer - inner)
        missing.append(_sigmas(deficit, expected * tail - outer_slope + inner_slope, C, b - a))
    return max(missing)


def _sigmas(value: float, slope: Array, C: Array, band_error: float = 0.0) -> float:
    return float(value / np.sqrt(max(float(slope @ C @ slope) + band_error**2, 1e-30)))
