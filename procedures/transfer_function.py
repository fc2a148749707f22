"""Transfer function of a PSF: phase along a direction, modulus over the band, numbers of an MTF curve."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import numpy.typing as npt

from procedures.numbers import LEVELS, MTF_CROSSINGS, MTF_NYQUIST, name_at
from procedures.numerics.arrays import Array
from procedures.numerics.kernel_tail import tail_spectra
from procedures.psf import Psf
from procedures.spatial_numbers import DrawnNumber

Otf = Callable[[Array, Array], npt.NDArray[np.complex128]]
"""A transfer function at frequencies (fx, fy) in cycles per pixel of the plane."""

NYQUIST = 0.5
"""Cycles per pixel."""
CHUNK = 16
"""Number of frequencies by which a curve is extended until it crosses a level."""


def phase_along(psf: Psf, f: Array, angle: float) -> tuple[Array, Array]:
    """Phase of the OTF at frequencies f (n,) along a direction (radians from x to y), with standard uncertainty.

    Both in degrees, unwrapped from 0 at frequency 0. A linear phase is a shift from the PSF's centre, the remainder
    asymmetry. Where the OTF is below its noise the phase is meaningless.
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
    n : frequencies along each axis, odd

    Returns
    -------
    f : (n,) float64
        In cycles/pixel.
    mtf : (n, n) float64
        [fy, fx], 1 in the centre.
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


# --- numbers read from an MTF curve ----------------------------------------------------------------------------------
#
# Between the frequencies of a curve it is a parabola through three of them: a straight line errs by up to 5e-4.


def curve_numbers(f: Array, mtf: Array, slope: Array, name: str, at: Sequence[float] = ()) -> Iterator[DrawnNumber]:
    """Numbers of one curve.

    f, mtf : (n,) cycles per pixel, equally spaced from 0, and the moduli
    slope : (n, m) derivative of the moduli by the PSF's parameters
    name : name of the direction
    at : frequencies at which the MTF is reported; those beyond the curve are omitted
    """
    i = int(np.searchsorted(f, NYQUIST))
    yield DrawnNumber(MTF_NYQUIST[name], float(mtf[i]), "1", "|OTF| at 0.5 cycles/pixel", slope[i])
    for level in LEVELS:
        if (crossed := crossing(f, mtf, slope, level / 100)) is not None:
            method = f"first crossing of |OTF| = {level / 100:g}"
            yield DrawnNumber(MTF_CROSSINGS[level, name], crossed[0], "cycles/pixel", method, crossed[1])
    for frequency in at:
        if 0 <= frequency <= f[-1]:
            value, gradient = _at(f, mtf, slope, frequency)
            yield DrawnNumber(name_at(frequency, name), value, "1", f"|OTF| at {frequency:.6g} cycles/pixel", gradient)


def crossing(f: Array, mtf: Array, slope: Array, level: float = 0.5) -> tuple[float, Array] | None:
    """First frequency below a level, and its derivative; None where the curve stays above."""
    below = np.flatnonzero(mtf < level)
    if not len(below):
        return None
    i = max(int(below[0]), 2)
    step = f[1] - f[0]
    a, b, c = mtf[i - 2 : i + 1]
    bend, tilt = (a - 2 * b + c) / 2, (c - a) / 2
    t = 0.0 if b == level else _root(bend, tilt, b - level)
    steepness = -(tilt + 2 * bend * t) / step
    return float(f[i - 1] + t * step), np.asarray(_parabola(t) @ slope[i - 2 : i + 1] / steepness)


def first_crossing(f: Array, curve: Callable[[Array], tuple[Array, Array]]) -> tuple[float, Array] | None:
    """First frequency below one half, as `crossing`, computing the curve no farther than that.

    f : (n,) equally spaced frequencies; curve : values (m,) and slopes (m, p) at a range of these.
    """
    parts: list[tuple[Array, Array]] = []
    for first in range(0, len(f), CHUNK):
        parts.append(curve(f[first : first + CHUNK]))
        if (parts[-1][0] < 0.5).any():
            value, slope = (np.concatenate(parts) for parts in zip(*parts, strict=True))
            return crossing(f, value, slope)
    return None


def _at(f: Array, mtf: Array, slope: Array, frequency: float) -> tuple[float, Array]:
    """Value of a curve at a frequency, and its derivative."""
    step = f[1] - f[0]
    i = int(np.clip(round(frequency / step), 1, len(f) - 2))
    weights = _parabola((frequency - f[i]) / step)
    return float(weights @ mtf[i - 1 : i + 2]), np.asarray(weights @ slope[i - 1 : i + 2])


def _parabola(t: float) -> Array:
    """Weights at t of three values at -1, 0, 1 in the parabola through them."""
    return np.array([t * (t - 1) / 2, 1 - t * t, t * (t + 1) / 2])


def _root(bend: float, tilt: float, above: float) -> float:
    """The root of bend t^2 + tilt t + above that is nearest to 0, on a falling curve."""
    discriminant = max(tilt * tilt - 4 * bend * above, 0.0)
    return float(2 * above / (-tilt + np.sqrt(discriminant)))
