"""Transfer function of a PSF: phase along a direction, modulus over the band, numbers of an MTF curve."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from procedures.numbers import LEVELS, MTF_CROSSINGS, MTF_NYQUIST, name_at
from procedures.numerics.arrays import Array, Complex, Mask
from procedures.numerics.kernel_tail import tail_border, tail_kernels, tail_spectra
from procedures.psf import Psf
from procedures.spatial_numbers import DrawnNumber

Otf = Callable[[Array, Array], Complex]  # a transfer function at frequencies (fx, fy) in cycles per pixel of the plane

NYQUIST = 0.5  # cycles per pixel
CHUNK = 16  # number of frequencies by which a curve is extended until it crosses a level


def phase_along(psf: Psf, f: Array, angle: float) -> tuple[Array, Array]:
    """Phase of the OTF in degrees along a direction, unwrapped from 0, and its uncertainty; linear: a shift, the rest:
    asymmetry; meaningless below the noise."""
    waves = psf.spectra(f * np.cos(angle), f * np.sin(angle))
    value = waves @ psf.parameters
    slope = np.imag(np.conj(value)[:, None] * waves) / np.maximum(np.abs(value) ** 2, 1e-300)[:, None]
    variance = np.einsum("ij,ij->i", slope @ psf.parameter_covariance, slope)
    return np.degrees(np.unwrap(np.angle(value))), np.degrees(np.sqrt(np.maximum(variance, 0)))


def mtf_map(psf: Psf, n: int) -> tuple[Array, Array]:
    """|OTF| over the square |fx|, |fy| <= s/2.

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


# --- numbers read from an MTF curve ---
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
    """First frequency below one half, as `crossing`, of equally spaced f (n,), for a curve that gives values and slopes
    at a range of these, no farther."""
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


# --- Radial profile of a PSF: mean over directions, and encircled energy, from the centre to the end of the tail ---

STEPS_PER_SAMPLE = 2  # circles per sample inside the support
RADIUS_RATIO = 1.2  # ratio of successive radii outside the support
DIRECTIONS = 32
OVERSAMPLING = 4  # points per sample of the sum inside a circle


@dataclass(frozen=True, eq=False)
class RadialProfile:
    """Mean of a PSF over directions about its centre, and encircled energy, with standard uncertainties.

    radius : (n,) in pixels of the plane, from 0
    density, density_uncertainty : (n,) energy per square pixel on each circle, for total energy 1
    energy, energy_uncertainty : (n,) share of the total energy inside each circle
    support : radius in pixels of the largest circle inside the support; beyond it the profile is that of the tail's
        shapes
    """

    radius: Array
    density: Array
    density_uncertainty: Array
    energy: Array
    energy_uncertainty: Array
    support: float


def radial_profile(psf: Psf) -> RadialProfile:
    """The profile of the band-limited PSF between its samples, then of its tail's shapes to their end; without a tail,
    to the largest circle in the support."""
    p, n = psf.parameters, psf.k**2
    radius, on, inside = _weights(psf.k, with_tail=len(p) > n)
    on, inside = on[:, : len(p)] * psf.s**2, inside[:, : len(p)]
    density, energy = on @ p / psf.light, inside @ p / psf.light
    return RadialProfile(
        radius / psf.s,
        density,
        _sigma(psf, (on - density[:, None] * psf.weights) / psf.light),
        energy,
        _sigma(psf, (inside - energy[:, None] * psf.weights) / psf.light),
        psf.k // 2 / psf.s,
    )


def _sigma(psf: Psf, slope: Array) -> Array:
    variance = np.einsum("ij,ij->i", slope @ psf.parameter_covariance, slope)
    return np.asarray(np.sqrt(np.maximum(variance, 0)))


@lru_cache(maxsize=8)
def _weights(k: int, *, with_tail: bool) -> tuple[Array, Array, Array]:
    """Radii in samples (n,), and the contributions of each parameter to the density per squared sample on the circles
    and to the energy inside them, (n, k^2 + q) each."""
    radius = np.arange(STEPS_PER_SAMPLE * (k // 2) + 1) / STEPS_PER_SAMPLE
    if not with_tail:
        offsets = np.arange(k) - k // 2
        on, inside = _on_circles(radius, offsets, k), _inside_circles(radius, offsets)
        return radius, on.reshape(len(radius), -1), inside.reshape(len(radius), -1)
    end = tail_border(k)
    steps = int(np.log(end / radius[-1]) / np.log(RADIUS_RATIO))
    radius = np.concatenate([radius, end * RADIUS_RATIO ** np.arange(-steps, 1.0)])
    offsets = np.arange(-end, end + 1)
    images = tail_kernels(k).reshape(-1, len(offsets) ** 2).T
    rows = slice(end - k // 2, end + k // 2 + 1)
    contributions = []
    for weights in (_on_circles(radius, offsets, k), _inside_circles(radius, offsets)):
        inside = weights[:, rows, rows].reshape(len(radius), -1)
        contributions.append(np.hstack([inside, weights.reshape(len(radius), -1) @ images]))
    # contributions (n, q) of unit amplitudes to the mean on circles outside the support, where the shapes are powers
    # of r, the anisotropic ones times cosines and sines of the direction
    (x, y), kernels, at = _circles(radius), tail_kernels(k), k // 2 + 1
    r, angle = np.maximum(np.hypot(x, y), 1.0), np.arctan2(y, x)
    mean, close = (
        shape[len(shape) // 2, len(shape) // 2 + at] * (at / r) ** power
        for shape, power in zip(kernels[:2], (3, 5), strict=True)
    )
    anisotropic = [mean * wave(m * angle) for m in (2, 4) for wave in (np.cos, np.sin)]
    outside = ~_within(x, y, k)
    tail_on_circles = np.stack([(shape * outside).mean(axis=1) for shape in (mean, close, *anisotropic)], axis=1)
    contributions[0][:, k * k :] += tail_on_circles
    return radius, contributions[0], contributions[1]


def _circles(radius: Array) -> tuple[Array, Array]:
    """Points (x, y) in DIRECTIONS on circles, (n, d) each."""
    turn = np.arange(DIRECTIONS) * 2 * np.pi / DIRECTIONS
    return radius[:, None] * np.cos(turn), radius[:, None] * np.sin(turn)


def _within(x: Array, y: Array, k: int) -> Mask:
    return np.asarray(np.maximum(np.abs(x), np.abs(y)) <= k / 2)


def _on_circles(radius: Array, offsets: npt.NDArray[np.intp], k: int) -> Array:
    """Contributions (n, size, size) of samples at these offsets to the mean of the band-limited image on circles inside
    the support."""
    contributions = np.zeros((len(radius), len(offsets), len(offsets)))
    reaching = radius <= k / 2**0.5  # larger circles lie outside
    x, y = _circles(radius[reaching])
    across, down = (np.sinc(at[..., None] - offsets) for at in (x, y))
    contributions[reaching] = (down * _within(x, y, k)[..., None]).transpose(0, 2, 1) @ across / DIRECTIONS
    return contributions


def _inside_circles(radius: Array, offsets: npt.NDArray[np.intp]) -> Array:
    """Contributions (n, size, size) of samples to the energy inside circles: over squares FINE times smaller, weighted
    by a ramp at the circle, in one quadrant."""
    end = int(offsets[-1])
    t = np.arange(OVERSAMPLING * end + 1) / OVERSAMPLING
    M = np.sinc(t[:, None] - np.arange(end + 1)) + np.sinc(t[:, None] + np.arange(end + 1))
    M[0] /= 2  # an axis belongs to both sides
    distance = np.hypot(t, t[:, None])
    contributions = np.empty((len(radius), end + 1, end + 1))
    for i, r in enumerate(radius):
        reached = int(np.searchsorted(t, r + 1 / OVERSAMPLING))
        near = M[:reached]
        weight = np.clip((r - distance[:reached, :reached]) * OVERSAMPLING + 0.5, 0, 1) * (r > 0) / OVERSAMPLING**2
        contributions[i] = near.T @ (weight @ near)
    return contributions[:, np.abs(offsets)[:, None], np.abs(offsets)]
