"""Sharpening told by the PSF: light does not leave less around its core than its far tail tells, sharpening does.

Sharpening subtracts a blurred picture from the picture, which digs a ring around the PSF's core. A lens cannot: beyond
the core the mean PSF falls to its tail of a / r^3 from above, whatever the aberrations, and the tail is not negative.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from procedures.numerics.kernel_tail import tail_border
from procedures.psf import Psf
from procedures.spatial_numbers import energy_within

Array = npt.NDArray[np.float64]
Light = tuple[float, Array]
"""A share of all light, and its derivative by the PSF's parameters."""

RINGS_PX = (0.8, 1.2, 1.8, 2.7)
"""Radii between which the light is summed."""
LEAST = 0.6
"""Of the far tail's light between two radii, what any lens leaves there."""
FARTHER_PX = (2.7, 6.0)
"""Radii between which light is seen by itself: it is better known than how it falls from there to the tail's end."""
COMPACT = 0.05
"""Share of all light between those up to which the core lies well inside."""
LEAST_COMPACT = 0.75
"""Of what that light tells by 1 / r^3 of a ring farther in, what a lens with so compact a core leaves there. In focus
and out of it, at cutoffs of 0.8 to 3.3 cycles/pixel, it was 0.97 and more."""


def missing_light(psf: Psf) -> float:
    """By how many standard uncertainties the rings around the core, or the tail, have less light than a lens leaves.

    Negative where they have more. The tail beyond the support predicts 2 pi a (1 / r - 1 / R) between r and R; so does,
    in the ratio of such differences, the light seen farther out.
    """
    if not len(psf.tail.amplitudes):
        return -np.inf
    C, tail = psf.parameter_covariance, np.zeros(len(psf.parameters))
    tail[psf.k**2] = psf.tail_density_px / psf.tail.amplitudes[0] if psf.tail.amplitudes[0] else 0.0
    lacking = [_sigmas(-psf.tail_density_px, tail, C)]
    farther = _farther(psf)
    for fall, (light, of_light) in _rings(psf):
        expected = LEAST * 2 * np.pi * fall
        less = expected * max(psf.tail_density_px, 0.0) - light
        lacking.append(_sigmas(less, expected * tail - of_light, C))
        if farther is not None:
            seen, of_seen = farther
            told = LEAST_COMPACT * fall
            lacking.append(_sigmas(told * seen - light, told * of_seen - of_light, C))
    return max(lacking)


def _rings(psf: Psf) -> Iterator[tuple[float, Light]]:
    """1 / r - 1 / R and the light of the rings that lie inside the support."""
    radii = [radius for radius in RINGS_PX if radius <= psf.k / 2 / psf.s]
    within = [energy_within(psf, radius) for radius in radii]
    for (r, R), (inner, outer) in zip(pairwise(radii), pairwise(within), strict=True):
        yield 1 / r - 1 / R, _between(inner, outer)


def _farther(psf: Psf) -> Light | None:
    """The light seen farther out, over its 1 / r - 1 / R; None where there is none, or so much that it is the core's.

    It is seen as far as the tail's shapes reach.
    """
    r, R = FARTHER_PX[0], min(FARTHER_PX[1], tail_border(psf.k) / psf.s)
    if r >= R:
        return None
    light, slope = _between(energy_within(psf, r), energy_within(psf, R))
    fall = 1 / r - 1 / R
    return (light / fall, slope / fall) if 0 < light <= COMPACT else None


def _between(inner: Light, outer: Light) -> Light:
    return outer[0] - inner[0], outer[1] - inner[1]


def _sigmas(value: float, slope: Array, C: Array) -> float:
    return float(value / np.sqrt(max(float(slope @ C @ slope), 1e-30)))
