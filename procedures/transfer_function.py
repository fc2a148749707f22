"""A whole PSF's transfer function as it is drawn: its phase along a direction, its modulus over the whole band."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from procedures.numerics.kernel_tail import tail_spectra
from procedures.psf import Psf

Array = npt.NDArray[np.float64]
Otf = Callable[[Array, Array], npt.NDArray[np.complex128]]
"""A transfer function at frequencies (fx, fy) in cycles per pixel of the plane."""


def phase_along(psf: Psf, f: Array, angle: float) -> tuple[Array, Array]:
    """The OTF's phase at frequencies f (n,) along a direction (radians from x towards y), and its standard uncertainty.

    Both in degrees, unwrapped from 0 at frequency 0; a straight line is a shift from the PSF's centre, what bends away
    from it is asymmetry. Where the OTF drowns in its noise the phase means nothing.
    """
    waves = psf.spectra(f * np.cos(angle), f * np.sin(angle))
    value = waves @ psf.parameters
    slope = np.imag(np.conj(value)[:, None] * waves) / np.maximum(np.abs(value) ** 2, 1e-300)[:, None]
    variance = np.einsum("ij,ij->i", slope @ psf.parameter_covariance, slope)
    return np.degrees(np.unwrap(np.angle(value))), np.degrees(np.sqrt(np.maximum(variance, 0)))


def mtf_map(psf: Psf, n: int) -> tuple[Array, Array]:
    """|OTF| over the square |fx|, |fy| <= s/2.

    Parameters
    ----------
    n : int
        Frequencies along each axis, odd.

    Returns
    -------
    f : (n,) float64
        In cycles/pixel.
    mtf : (n, n) float64
        [fy, fx], 1 in the middle.
    """
    f = np.linspace(-psf.s / 2, psf.s / 2, n)
    upper = f[n // 2 :]  # the rest is its mirror image
    across = np.exp(-2j * np.pi * f[:, None] * psf.offsets_px)
    down = np.exp(-2j * np.pi * upper[:, None] * psf.offsets_px)
    value = down @ psf.h @ across.T
    if q := len(psf.tail.amplitudes):
        fx, fy = np.meshgrid(f / psf.s, upper / psf.s)
        tail = tail_spectra(fx.ravel(), fy.ravel(), psf.k)[:, :q] @ psf.tail.amplitudes
        value = value + tail.reshape(value.shape)
    half = np.abs(value) / psf.light
    return f, np.vstack([half[:0:-1, ::-1], half])
