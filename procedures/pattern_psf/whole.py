"""The MTF with what the support cuts off: the k x k samples, and the 1/r^3 tail beyond them, as fitted together.

The samples alone are of sum 1, and their MTF is that of the light inside the support. Whoever sees all the light (a
slanted edge, an observer) sees the tail too, and a lower MTF.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.numerics.kernel_tail import tail_density, tail_spectrum, tail_sum
from procedures.outcome import Quantity
from procedures.psf import Psf

Array = npt.NDArray[np.float64]

SHAPE = 0.06
"""Relative uncertainty of the tail's energy beyond its noise: no true tail is quite 1 / r^3. On a simulated lens at
f/5.6 without noise the energy came out 5 % too large."""
STEP = 0.005
"""Cycles per pixel between the frequencies among which MTF50 is interpolated."""


@dataclass(frozen=True)
class Tail:
    """Energy of the tail within its reach over that inside the support, and what it varies with.

    Attributes
    ----------
    energy : float
    covariance : (k^2,) float64
        With the samples of the PSF of sum 1.
    variance : float
    """

    energy: float
    covariance: Array
    variance: float

    @property
    def relative_uncertainty(self) -> float:
        """Of its energy, noise and shape together; infinite where there is no tail."""
        noise = self.variance**0.5 / abs(self.energy) if self.energy else np.inf
        return float(np.hypot(noise, SHAPE))

    def density_px(self, psf: Psf) -> float:
        """A of the tail A / r^3 per square pixel, r in pixels, where all light is 1."""
        return self.energy * tail_density(psf.k) / psf.s / (1 + self.energy * tail_sum(psf.k))


def mtf50_along(psf: Psf, tail: Tail, angle_deg: float, n: int) -> Quantity | None:
    """MTF50 along a direction, from x towards y, of all the light; None where the MTF stays above one half."""
    f = np.arange(0, psf.s / 2, STEP)
    turn = np.radians(angle_deg)
    fx, fy = f * np.cos(turn), f * np.sin(turn)
    waves = np.exp(-2j * np.pi * fx[:, None, None] * psf.offsets_px) * np.exp(
        -2j * np.pi * fy[:, None, None] * psf.offsets_px[:, None]
    )
    waves = waves.reshape(len(f), -1)
    beyond, whole = tail_spectrum(fx / psf.s, fy / psf.s, psf.k), tail_sum(psf.k)
    light = 1 + tail.energy * whole
    otf = waves @ psf.h.ravel() + tail.energy * beyond
    mtf = np.abs(otf) / light
    below = np.flatnonzero(mtf < 0.5)
    if not len(below):
        return None
    i = below[0]
    t = (mtf[i - 1] - 0.5) / (mtf[i - 1] - mtf[i])
    phase = np.conj(otf) / np.abs(otf)
    of_h = np.real(phase[:, None] * waves)[[i - 1, i]] / light
    of_tail = (np.real(phase * beyond) - mtf * whole)[[i - 1, i]] / light
    share = np.array([1 - t, t])
    h, e = share @ of_h, float(share @ of_tail)
    variance = (
        h @ psf.covariance @ h
        + 2 * e * float(h @ tail.covariance)
        + e * e * (tail.variance + (SHAPE * tail.energy) ** 2)
    )
    steepness = (mtf[i - 1] - mtf[i]) / STEP
    return Quantity(
        float((i - 1 + t) * STEP),
        "cycles/pixel",
        float(np.sqrt(max(variance, 0.0)) / steepness),
        f"|OTF| = 0.5 at {angle_deg:.1f} degrees from x, tail beyond the support included",
        n,
    )
