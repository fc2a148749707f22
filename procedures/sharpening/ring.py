"""Sharpening told by the PSF: light does not leave less around its core than its far tail tells, sharpening does.

Sharpening subtracts a blurred picture from the picture, which digs a ring around the PSF's core. A lens cannot: beyond
the core the mean PSF falls to its tail of a / r^3 from above, whatever the aberrations, and the tail is not negative.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from procedures.psf import Psf
from procedures.spatial_numbers import energy_within

Array = npt.NDArray[np.float64]

RINGS_PX = (0.8, 1.2, 1.8, 2.7)
"""Radii between which the light is summed."""
LEAST = 0.6
"""Of the far tail's light between two radii, what any lens leaves there."""
NARROWER = 0.85
"""Share of the band within which the rings are looked at again: a band that ends where the OTF has not leaves rings
that are its own, and half of what they change is doubt."""


def missing_light(psf: Psf) -> float:
    """By how many standard uncertainties the rings around the core, or the tail, have less light than a lens leaves.

    Negative where they have more. The tail beyond the support predicts 2 pi a (1 / r - 1 / R) between r and R.
    A band that ends before the OTF does is in the uncertainty.
    """
    C, tail = psf.parameter_covariance, np.zeros(len(psf.parameters))
    if not len(psf.tail.amplitudes):
        return -np.inf
    tail[psf.k**2] = psf.tail_density_px / psf.tail.amplitudes[0] if psf.tail.amplitudes[0] else 0.0
    radii = [radius for radius in RINGS_PX if radius <= psf.k / 2 / psf.s]
    within, narrow = [energy_within(psf, radius) for radius in radii], psf.narrowed(NARROWER)
    moved = [(energy_within(narrow, radius)[0] - one) / 2 for radius, (one, _) in zip(radii, within, strict=True)]
    lacking = [_sigmas(-psf.tail_density_px, tail, C)]
    rings = zip(pairwise(radii), pairwise(within), pairwise(moved), strict=True)
    for (r, R), ((inner, of_inner), (outer, of_outer)), (a, b) in rings:
        expected = LEAST * 2 * np.pi * (1 / r - 1 / R)
        less = expected * max(psf.tail_density_px, 0.0) - (outer - inner)
        lacking.append(_sigmas(less, expected * tail - of_outer + of_inner, C, b - a))
    return max(lacking)


def _sigmas(value: float, slope: Array, C: Array, beside: float = 0.0) -> float:
    return float(value / np.sqrt(max(float(slope @ C @ slope) + beside**2, 1e-30)))
