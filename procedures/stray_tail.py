"""Model error of a PSF's tail: departure of the true tail from its few shapes, and the effect on OTF and energy."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from procedures.numerics.arrays import Array
from procedures.numerics.bessel import j0
from procedures.numerics.kernel_tail import DIFFERS, LEAST_TAIL
from procedures.psf import Psf

ROUGHNESS = 0.25
"""Relative deviation of a true tail's density from the fitted one: rings of a small aperture, spikes of an iris. For
Airy discs, defocus, coma and polygons it was 0.1 to 0.3, for spikes up to 1."""
RINGS = 0.25
"""Effect of a pupil's rings on the energy outside a square support, over (f_c R)^-3/2 of it.

The phase is stationary at the middles of the four sides: 1 / (8^1/2 pi) = 0.11 for the rings 1 - sin(2 pi f_c r) of a
clear circle, 0.46 for the slower beat, of period 2 / ((1 - 0.3) f_c), of a pupil obstructed to 0.3 of its diameter."""
RING_FREQUENCIES = np.linspace(0.25, 1.0, 13)
"""Frequencies of rings, over f_c: from the beat of a pupil obstructed to a half to the rings of a clear one."""
RING_RADII = np.arange(1.02, 9.0, 0.04)
"""Radii over that of the support at which rings are summed; they are tapered towards the end."""
FINEST_RINGS = 8.0
"""Greatest f_c R that is distinguished: finer rings have no effect."""


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


def curve_model_error(psf: Psf, f: Array, mtf: Array, slope: Array, passed: Array | float = 1.0) -> Array:
    """Standard uncertainty (n,) of an MTF curve by the model error of the tail.

    Three independent parts: the tail's roughness, its rings, and the energy outside the support, by which the OTF is
    normalised. All vanish at frequency 0.

    f : (n,) in cycles/pixel
    mtf : (n,) the PSF's MTF
    slope : (n, k^2 + q or more); derivative of the curve by the PSF's parameters
    passed : (n,) float64 or float; factor by which the MTF was divided to give the curve
    """
    if not len(psf.tail.amplitudes):
        return np.zeros(len(f))
    radius, mean_tail = psf.k / 2 / psf.s, psf.k**2
    rough = truncation(psf) * (1 - np.exp(-((np.pi * f * radius) ** 2)))
    rings = abs(psf.share_outside) * _rings_at(psf, f, mtf)
    energy = tail_energy_uncertainty(psf) * psf.light / float(psf.weights[mean_tail]) * slope[:, mean_tail]
    return np.asarray(np.hypot(np.hypot(rough, rings) / passed, energy))


def _rings_at(psf: Psf, f: Array, mtf: Array) -> Array:
    """Rms change (n,) of an MTF by rings of unknown phase and frequency, over the energy outside.

    Rings 1 + cos(2 pi v r + phase) of the mean tail 1 / r^3 have the spectrum

        G(f, v) = integral of w(r) r^-2 exp(2 pi i v r) J0(2 pi f r) dr,

    r and 1 / f in units of the support's half side, w(r) the share of a circle outside the square. The OTF is divided
    by the whole energy, so that its change is G(f, v) - H(f) G(0, v).
    """
    radius = psf.k / 2 / psf.s
    cutoff = 1 / (np.pi**3 * max(psf.tail_density_px, 1e-9))
    rings = np.exp(2j * np.pi * RING_FREQUENCIES[:, None] * min(cutoff * radius, FINEST_RINGS) * RING_RADII)
    outside = 4 / np.pi * np.arccos(1 / np.minimum(RING_RADII, 2**0.5))
    rings = rings * outside / RING_RADII**2 * np.exp(-((RING_RADII / 5) ** 2)) * float(np.diff(RING_RADII[:2])[0])
    change = rings @ _waves(tuple((f * radius).tolist())) - mtf * rings.sum(axis=1)[:, None]
    return np.asarray(np.sqrt(np.mean(np.abs(change) ** 2, axis=0) / 2))


@lru_cache(maxsize=16)
def _waves(fR: tuple[float, ...]) -> Array:
    """J0(2 pi f r) at the radii of the rings (m,) and frequencies (n,), both in units of the support: (m, n)."""
    return j0(2 * np.pi * RING_RADII[:, None] * np.array(fR))
