"""Model error of a PSF's tail: departure of the true tail from its few shapes, and the effect on OTF and energy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from procedures.numerics.kernel_tail import DIFFERS, LEAST_TAIL
from procedures.psf import Psf

Array = npt.NDArray[np.float64]

ROUGHNESS = 0.25
"""Relative deviation of a true tail's density from the fitted one: rings of a small aperture, spikes of an iris. For
Airy discs, defocus, coma and polygons it was 0.1 to 0.3, for spikes up to 1."""
RINGS = 1 / (8**0.5 * np.pi)
"""Effect of the rings 1 - sin(2 pi f_c r) of a circular pupil at a square support's border, over (f_c R)^-3/2 of the
energy outside; the phase is stationary at the middles of the four sides."""


def truncation(psf: Psf) -> float:
    """Standard uncertainty of the OTF by the model error of the tail, at frequencies resolved by the support.

    A tail of energy E outside a radius R has the density E R / (2 pi r^3). A relative deviation of `ROUGHNESS`,
    constant over a square pixel and independent between pixels, changes the OTF by ROUGHNESS E sqrt(pi / 2) / (2 pi R).
    """
    radius = psf.k / 2 / psf.s
    return ROUGHNESS * abs(psf.share_outside) * float(np.sqrt(np.pi / 2)) / (2 * np.pi * radius)


def tail_energy_uncertainty(psf: Psf) -> float:
    """Standard uncertainty of the share outside the support by the model error: ROUGHNESS E / (R sqrt(8 pi)).

    At small apertures rings are wider than pixels and coherent: RINGS E / (f_c R)^3/2, f_c from the far tail. Where the
    amplitudes of the shapes exceed those of a lens in focus (coma and astigmatism in the corner of a field, extending
    beyond the support), the model error is scaled by the same factor.
    """
    radius = psf.k / 2 / psf.s
    rings = float(np.pi**3 * max(psf.tail_density_px, 0.0) / radius) ** 1.5
    rough = _excess_factor(psf) * ROUGHNESS / (radius * float(np.sqrt(8 * np.pi)))
    return abs(psf.share_outside) * float(np.hypot(rough, RINGS * rings))


def _excess_factor(psf: Psf) -> float:
    """Rms ratio of the amplitudes, except the mean tail's, to their expected values, at least 1.

    A single large amplitude, as of the spikes of an iris with few blades, counts by its ratio minus 1.
    """
    first, *others = psf.tail.amplitudes.tolist() or [0.0]
    ratios = np.abs(others) / (DIFFERS[: len(others)] * max(abs(first), LEAST_TAIL))
    return max(1.0, float(np.sqrt(np.mean(ratios**2))), float(ratios.max()) - 1) if others else 1.0


def truncation_at(psf: Psf, f: Array) -> Array:
    """Truncation uncertainty at frequencies (n,): 0 at frequency 0, as the OTF is normalised there."""
    radius = psf.k / 2 / psf.s
    return np.asarray(truncation(psf) * (1 - np.exp(-((np.pi * f * radius) ** 2))))
