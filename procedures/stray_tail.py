"""What the tail's few shapes leave out of a PSF's tail: how far the true one may stray from it, and what that moves."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from procedures.numerics.kernel_tail import DIFFERS, LEAST_TAIL
from procedures.psf import Psf

Array = npt.NDArray[np.float64]

ROUGHNESS = 0.25
"""How far a true tail strays from the fitted one, ring by ring, over its density: rings of a small aperture, spikes of
an iris. On tails of Airy's disc, defocus, coma and polygons it was 0.1 to 0.3, of spikes up to 1."""
RINGS = 1 / (8**0.5 * np.pi)
"""Of the rings of a circular pupil, 1 - sin(2 pi f_c r) about the mean tail: what a square support's border cuts off of
one more or less, over (f_c R)^-3/2 of the energy outside. The phase is stationary at the middles of its four sides."""


def truncation(psf: Psf) -> float:
    """Standard uncertainty of the OTF from what the tail's few shapes leave out, at frequencies that the support holds.

    A tail of energy E outside a radius R has the density E R / (2 pi r^3). If the true one strays from it by a share of
    `ROUGHNESS`, alike over a square pixel and independently from the next, the OTF strays by
    ROUGHNESS E sqrt(pi / 2) / (2 pi R).
    """
    radius = psf.k / 2 / psf.s
    return ROUGHNESS * abs(psf.share_outside) * float(np.sqrt(np.pi / 2)) / (2 * np.pi * radius)


def stray_energy(psf: Psf) -> float:
    """Standard uncertainty of the share outside the support from the same: ROUGHNESS E / (R sqrt(8 pi)).

    At small apertures rings are wider than pixels, and alike all around: RINGS E / (f_c R)^3/2, f_c by the far tail.
    Where the tail strays farther into its shapes than a lens in focus lets expect (coma and astigmatism of a field's
    corner, reaching beyond the support), it strays as much farther from them.
    """
    radius = psf.k / 2 / psf.s
    rings = float(np.pi**3 * max(psf.tail_density_px, 0.0) / radius) ** 1.5
    rough = _surprise(psf) * ROUGHNESS / (radius * float(np.sqrt(8 * np.pi)))
    return abs(psf.share_outside) * float(np.hypot(rough, RINGS * rings))


def _surprise(psf: Psf) -> float:
    """Root mean square of the amplitudes beside the mean tail's over what is expected of them, at least 1.

    Where one of them alone strays, by that less 1: spikes of an iris of few blades, alike along all their length.
    """
    first, *others = psf.tail.amplitudes.tolist() or [0.0]
    strayed = np.abs(others) / (DIFFERS[: len(others)] * max(abs(first), LEAST_TAIL))
    return max(1.0, float(np.sqrt(np.mean(strayed**2))), float(strayed.max()) - 1) if others else 1.0


def stray_at(psf: Psf, f: Array) -> Array:
    """The truncation's uncertainty at frequencies (n,): none at 0, where all light is counted."""
    radius = psf.k / 2 / psf.s
    return np.asarray(truncation(psf) * (1 - np.exp(-((np.pi * f * radius) ** 2))))
