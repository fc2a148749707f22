"""What a PSF says about a camera: OTF, MTF and the numbers drawn from them, each with its standard uncertainty.

Every number is a smooth function of the PSF's samples; its uncertainty is the linear propagation of their covariance
(the tests hold it against Monte Carlo). Frequencies are in cycles per pixel of the plane, lengths in its pixels.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.numerics.bessel import j1
from procedures.outcome import Quantity
from procedures.psf import Psf

Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]
Indices = npt.NDArray[np.intp]

STEPS_PER_CYCLE = 50
"""Frequencies of the curves per cycle/pixel."""
DIRECTIONS = 16
"""Directions of the radial mean over half a turn, an even number."""
WAVELENGTHS_NM = {"R": 600.0, "G": 530.0, "B": 460.0, "Y": 550.0}
"""Where a plane of usual colour filters is most sensitive."""


@dataclass(frozen=True)
class Quality:
    """The curves of one PSF, and its numbers by name.

    Attributes
    ----------
    frequencies : (n,) float64
        0 to s/2 cycles/pixel.
    mtf_horizontal, mtf_vertical, mtf_radial : (n,) float64
        |OTF| along x, along y, and its mean over directions.
    mtf_horizontal_uncertainty, ... : (n,) float64
        Their standard uncertainties.
    otf_horizontal, otf_vertical : (n,) complex128
        With phase: the PSF's centre is the origin.
    numbers : mapping of str to Quantity
    """

    frequencies: Array
    mtf_horizontal: Array
    mtf_horizontal_uncertainty: Array
    mtf_vertical: Array
    mtf_vertical_uncertainty: Array
    mtf_radial: Array
    mtf_radial_uncertainty: Array
    otf_horizontal: Complex
    otf_vertical: Complex
    numbers: Mapping[str, Quantity]


@dataclass(frozen=True)
class Diffraction:
    """What sets the diffraction limit of a plane.

    Attributes
    ----------
    f_number : float
    pixel_pitch_um : float
        Pitch of the *plane's* pixels (twice the sensor's for a Bayer plane), in micrometres.
    wavelength_nm : float
    """

    f_number: float
    pixel_pitch_um: float
    wavelength_nm: float

    @property
    def cutoff(self) -> float:
        """Highest frequency that the aperture passes, in cycles per pixel: pitch / (lambda N)."""
        return self.pixel_pitch_um / (self.wavelength_nm * 1e-3 * self.f_number)

    def psf(self, r: Array) -> Array:
        """Diffraction's PSF h_diff at distances r (pixels) from its centre, of unit volume.

        Source: thesis, section 2.2.1: the Airy pattern of a circular aperture.
        """
        x = np.pi * self.cutoff * np.asarray(r, dtype=np.float64)
        small = np.abs(x) < 1e-6
        ring = np.where(small, 0.5, j1(np.where(small, 1.0, x)) / np.where(small, 1.0, x))
        return np.asarray(np.pi * self.cutoff**2 * ring**2)

    def otf(self, f: Array) -> Array:
        """Diffraction's OTF at frequencies f (cycles/pixel)."""
        v = np.clip(np.abs(f) / self.cutoff, 0, 1)
        return np.asarray(2 / np.pi * (np.arccos(v) - v * np.sqrt(1 - v * v)))


def otf(psf: Psf, fx: Array, fy: Array) -> Complex:
    """The optical transfer function at frequencies (fx, fy) of any common shape: sum h exp(-2 pi i f.x)."""
    return np.asarray(_waves(psf, fx, fy) @ psf.h.ravel())


def assess(psf: Psf, *, n: int, diffraction: Diffraction | None = None) -> Quality:
    """Curves and numbers of a PSF.

    Parameters
    ----------
    psf : Psf
    n : int
        Number of samples the PSF was estimated from, for the record.
    diffraction : Diffraction, optional
        Where it is known, the Strehl ratio is reported too.
    """
    f = np.linspace(0, psf.s / 2, int(STEPS_PER_CYCLE * psf.s / 2) + 1)
    zero = np.zeros_like(f)
    horizontal, vertical = _waves(psf, f, zero), _waves(psf, zero, f)
    mtf_h, slope_h = _modulus(psf, horizontal)
    mtf_v, slope_v = _modulus(psf, vertical)
    mtf_r, slope_r = _radial_mean(psf, f)
    curves = {"horizontal": (mtf_h, slope_h), "vertical": (mtf_v, slope_v), "radial": (mtf_r, slope_r)}
    numbers: dict[str, Quantity] = {}
    for name, (mtf, slope) in curves.items():
        numbers |= _curve_numbers(psf, f, mtf, slope, name, n)
    numbers |= _spatial_numbers(psf, n)
    if diffraction is not None:
        numbers["strehl"] = _strehl(psf, diffraction, n)
    h = psf.h.ravel()
    return Quality(
        f,
        *(mtf_h, _uncertainty(psf, slope_h), mtf_v, _uncertainty(psf, slope_v), mtf_r, _uncertainty(psf, slope_r)),
        horizontal @ h,
        vertical @ h,
        numbers,
    )


def mtf_along(psf: Psf, f: Array, angle: float) -> tuple[Array, Array]:
    """|OTF| at frequencies f (n,) along a direction (radians from x towards y), and its derivative (n, k^2)."""
    return _modulus(psf, _waves(psf, f * np.cos(angle), f * np.sin(angle)))


def mtf50_along(psf: Psf, angle: float) -> tuple[float, Array] | None:
    """MTF50 along a direction in cycles/pixel, and its derivative (k^2,) with respect to the samples; None without."""
    f = np.linspace(0, psf.s / 2, int(STEPS_PER_CYCLE * psf.s / 2) + 1)
    return _crossing(f, *mtf_along(psf, f, angle))


def energy_above_nyquist(psf: Psf) -> tuple[float, Array]:
    """Share of |OTF|^2 outside |fx|, |fy| <= 1/2, what noise adds taken away, and its derivative (k^2,)."""
    S = _nyquist_kernel(psf)
    noise = _noise_of_energy(psf)
    through = S @ psf.h @ S
    inside, whole = float(np.sum(through * psf.h)) - noise[0], float(np.sum(psf.h**2)) - noise[1]
    derivative = 2 * (inside / whole * psf.h - through) / whole
    return 1 - inside / whole, derivative.ravel()


def _waves(psf: Psf, fx: Array, fy: Array) -> Complex:
    """exp(-2 pi i f.x) for frequencies of any shape (...,) and all samples: (..., k^2)."""
    x = psf.offsets_px
    ex = np.exp(-2j * np.pi * np.asarray(fx)[..., None] * x)
    ey = np.exp(-2j * np.pi * np.asarray(fy)[..., None] * x)
    return np.asarray((ey[..., :, None] * ex[..., None, :]).reshape(*np.shape(fx), psf.k**2))


def _modulus(psf: Psf, waves: Complex) -> tuple[Array, Array]:
    """|OTF| (n,) and its derivative with respect to the samples (n, k^2)."""
    value = waves @ psf.h.ravel()
    modulus = np.abs(value)
    phase = np.conj(value) / np.maximum(modulus, 1e-12)
    return modulus, np.real(phase[:, None] * waves)


def _radial_mean(psf: Psf, f: Array) -> tuple[Array, Array]:
    """Mean of |OTF| over directions (n,), and its derivative (n, k^2)."""
    direction = np.arange(DIRECTIONS)
    step = np.exp(-2j * np.pi / psf.s * f[:, None] * np.cos(np.pi * direction / DIRECTIONS))
    powers = np.cumprod(np.broadcast_to(step[..., None], (*step.shape, psf.k // 2)), axis=2)
    ex = np.concatenate([powers[..., ::-1].conj(), np.ones((*step.shape, 1)), powers], axis=2)  # (n, directions, k)
    ey = ex[:, np.abs(DIRECTIONS // 2 - direction)]  # the sine of a direction is the cosine of another
    value = np.sum((ey.reshape(-1, psf.k) @ psf.h).reshape(ex.shape) * ex, axis=2)
    modulus = np.abs(value)
    turned = (np.conj(value) / np.maximum(modulus, 1e-12))[..., None] * ey
    # the real part of the sum over directions of turned[y] ex[x], as one product of real matrices
    left, right = np.concatenate([turned.real, -turned.imag], axis=1), np.concatenate([ex.real, ex.imag], axis=1)
    slope = left.transpose(0, 2, 1) @ right / DIRECTIONS
    return modulus.mean(axis=1), slope.reshape(len(f), -1)


def _uncertainty(psf: Psf, slope: Array) -> Array:
    """Standard uncertainty of quantities whose derivatives are the rows of `slope`."""
    return np.asarray(np.sqrt(np.maximum(np.einsum("ij,ij->i", slope @ psf.covariance, slope), 0)))


def _curve_numbers(psf: Psf, f: Array, mtf: Array, slope: Array, name: str, n: int) -> dict[str, Quantity]:
    """MTF50 and MTF at Nyquist of one curve; no MTF50 where the curve stays above one half."""
    numbers = {}
    at_nyquist = slope[np.searchsorted(f, 0.5)]
    numbers[f"mtf_nyquist_{name}"] = Quantity(
        float(np.interp(0.5, f, mtf)),
        "1",
        float(_uncertainty(psf, at_nyquist[None])[0]),
        "|OTF| at 0.5 cycles/pixel",
        n,
    )
    crossing = _crossing(f, mtf, slope)
    if crossing is not None:
        value, derivative = crossing
        numbers[f"mtf50_{name}"] = Quantity(
            value,
            "cycles/pixel",
            float(_uncertainty(psf, derivative[None])[0]),
            "first crossing of |OTF| = 0.5",
            n,
        )
    return numbers


def _crossing(f: Array, mtf: Array, slope: Array) -> tuple[float, Array] | None:
    """Where a curve first falls below one half, and the derivative (k^2,) of that; None where it stays above."""
    below = np.flatnonzero(mtf < 0.5)
    if not len(below):
        return None
    i = below[0]
    t = (mtf[i - 1] - 0.5) / (mtf[i - 1] - mtf[i])
    steepness = (mtf[i - 1] - mtf[i]) / (f[i] - f[i - 1])
    derivative = ((1 - t) * slope[i - 1] + t * slope[i]) / steepness
    return float(f[i - 1] + t * (f[i] - f[i - 1])), np.asarray(derivative)


def _spatial_numbers(psf: Psf, n: int) -> dict[str, Quantity]:
    """Width, shape, energy: the numbers read from the samples themselves; those that do not exist are left out."""
    middle = psf.k // 2
    row = np.ravel_multi_index((middle, np.arange(psf.k)), psf.h.shape)
    column = np.ravel_multi_index((np.arange(psf.k), middle), psf.h.shape)
    weight = _moment_weight(psf)
    noise = _noise_of_energy(psf)
    probes = {"all": _Probe.of(psf, np.arange(psf.k**2)), "row": _Probe.of(psf, row), "column": _Probe.of(psf, column)}
    pieces: list[tuple[str, Callable[[Array], Array], tuple[tuple[str, str, str], ...]]] = [
        ("all", lambda h: _centroids(psf, h), (
            ("centroid_x", "pixel", "first moment, from the PSF's centre"),
            ("centroid_y", "pixel", "first moment, from the PSF's centre"))),
        ("row", lambda h: _widths(h, psf.s)[:, None], (("fwhm_horizontal", "pixel", "section through the centre"),)),
        ("column", lambda h: _widths(h, psf.s)[:, None], (("fwhm_vertical", "pixel", "section through the centre"),)),
        ("all", lambda h: _energy_above_nyquist(psf, h, noise)[:, None], (
            ("energy_above_nyquist", "1", "share of |OTF|^2"),)),
        ("all", lambda h: _encircling_radii(psf, h, (0.5, 0.8)), (
            ("encircled_energy_50", "pixel", "radius of 50 %"), ("encircled_energy_80", "pixel", "radius of 80 %"))),
        ("all", lambda h: _ellipse(psf, h, weight), (
            ("ellipticity", "1", "1 - b/a of weighted second moments"),
            ("ellipse_angle", "degree", "major axis, from x towards y"))),
    ]  # fmt: skip
    numbers = {}
    for used, function, described in pieces:
        values = function(probes[used].h[None])[0]
        periods = np.array([180.0 if unit == "degree" else np.inf for _, unit, _ in described])
        uncertainties = probes[used].uncertainties(function, periods)
        for (name, unit, method), value, uncertainty in zip(described, values, uncertainties, strict=True):
            if np.isfinite(value) and np.isfinite(uncertainty):
                numbers[name] = Quantity(float(value), unit, float(uncertainty), method, n)
    return numbers


@dataclass(frozen=True)
class _Probe:
    """Some samples of a PSF (m,), and the same with each moved up and down by a tenth of its deviation (m, m)."""

    h: Array
    C: Array
    steps: Array
    above: Array
    below: Array

    @classmethod
    def of(cls, psf: Psf, used: npt.NDArray[np.intp]) -> _Probe:
        h, C = psf.h.ravel()[used], psf.covariance[np.ix_(used, used)]
        steps = 0.1 * np.sqrt(np.maximum(np.diag(C), 1e-30))
        return cls(h, C, steps, h + np.diag(steps), h - np.diag(steps))

    def uncertainties(self, function: Callable[[Array], Array], periods: Array) -> Array:
        """Standard uncertainties (q,) of functions of the samples, (b, m) to (b, q), by their covariance.

        Values with a finite period, angles, differ modulo that.
        """
        change = function(self.above) - function(self.below)
        turns = np.where(np.isfinite(periods), periods, 1.0)
        change = np.where(np.isfinite(periods), (change + turns / 2) % turns - turns / 2, change)
        gradient = change.T / (2 * self.steps)
        return np.asarray(np.sqrt(np.maximum(np.sum((gradient @ self.C) * gradient, axis=1), 0)))


def _centroids(psf: Psf, h: Array) -> Array:
    """Centroids (b, 2) along x and y of PSFs (b, k^2), in pixels."""
    x = psf.offsets_px
    return np.asarray(h @ np.column_stack([np.tile(x, psf.k), np.repeat(x, psf.k)]) / h.sum(axis=1, keepdims=True))


def _widths(profiles: Array, s: int) -> Array:
    """Full widths at half maximum (b,) of band-limited sections (b, k), in pixels; NaN where there is none."""
    fine = 16
    k = profiles.shape[1]
    t = np.arange((k - 1) * fine + 1) / fine
    values = profiles @ np.sinc(t[:, None] - np.arange(k)).T
    peak = values.argmax(axis=1)[:, None]
    below = values < np.take_along_axis(values, peak, 1) / 2
    at = np.arange(values.shape[1])
    right, left = below & (at > peak), below & (at < peak)
    there = right.any(axis=1) & left.any(axis=1)
    high, low = right.argmax(axis=1), values.shape[1] - 1 - left[:, ::-1].argmax(axis=1)
    width = _half_way(values, peak, high, high - 1) - _half_way(values, peak, low, np.minimum(low + 1, at[-1]))
    return np.asarray(np.where(there, width, np.nan) / (fine * s))


def _half_way(values: Array, peak: Indices, outer: Indices, inner: Indices) -> Array:
    """Where sections (b, n) fall to half of their value at `peak` (b, 1), between two samples (b,) of each."""
    rows = np.arange(len(values))
    half, beyond, before = values[rows, peak[:, 0]] / 2, values[rows, outer], values[rows, inner]
    with np.errstate(divide="ignore", invalid="ignore"):  # where there is no crossing
        return np.asarray(inner + (outer - inner) * (before - half) / (before - beyond))


def _nyquist_kernel(psf: Psf) -> Array:
    """(k, k): the quadratic form S h S . h is the integral of |OTF|^2 over |fx|, |fy| <= 1/2, in units of sum h^2."""
    return np.asarray(np.sinc((np.arange(psf.k)[:, None] - np.arange(psf.k)) / psf.s) / psf.s)


def _noise_of_energy(psf: Psf) -> tuple[float, float]:
    """What noise adds, on average, to the energy inside the Nyquist square and to the whole."""
    S = _nyquist_kernel(psf)
    C = psf.covariance.reshape(psf.k, psf.k, psf.k, psf.k)
    inside = np.einsum("jb,jb->", S, np.einsum("ia,iajb->jb", S, C.transpose(0, 2, 1, 3)))
    return float(inside), float(np.trace(psf.covariance))


def _energy_above_nyquist(psf: Psf, h: Array, noise: tuple[float, float]) -> Array:
    """Share of the integral of |OTF|^2 outside |fx|, |fy| <= 1/2 of PSFs (b, k^2), what noise adds taken away."""
    S = _nyquist_kernel(psf)
    images = h.reshape(-1, psf.k, psf.k)
    # S X S . X = X S . (X' S)', each for all X as one product
    along, across = (np.reshape(x, (-1, psf.k)) @ S for x in (images, images.transpose(0, 2, 1)))
    inside = np.einsum("bij,bji->b", along.reshape(images.shape), across.reshape(images.shape)) - noise[0]
    whole = np.sum(images**2, axis=(1, 2)) - noise[1]
    return np.asarray(np.where(whole > 0, 1 - inside / whole, np.nan))


def _encircling_radii(psf: Psf, h: Array, shares: tuple[float, ...]) -> Array:
    """Radii (b, q) about the marks' centre within which shares (q,) of the energy of PSFs (b, k^2) lie."""
    x = psf.offsets_px
    r = np.hypot(x, x[:, None]).ravel()
    radii = np.arange(1, 4 * psf.k + 1) / (8 * psf.s)
    # a sample's energy enters linearly while the circle crosses its square
    inside = (h @ np.clip((radii - r[:, None]) * psf.s + 0.5, 0, 1)) / h.sum(axis=1, keepdims=True)
    rows, found = np.arange(len(h)), []
    for share in shares:
        i = np.argmax(inside >= share, axis=1)
        before, after = inside[rows, i - 1], inside[rows, i]
        radius = radii[i - 1] + (share - before) / np.where(i > 0, after - before, np.nan) * (radii[i] - radii[i - 1])
        found.append(np.where(i > 0, radius, np.nan))
    return np.column_stack(found)


def _moment_weight(psf: Psf) -> Array:
    """Gaussian weight (k^2,) as wide as the PSF's core: without it the far samples' noise rules the moments."""
    middle = psf.k // 2
    core = _widths(np.stack([psf.h[middle], psf.h[:, middle]]), psf.s)
    sigma = 1.5 * float(np.nanmean(core)) / 2.355 if np.isfinite(core).any() else psf.k / (4 * psf.s)
    x = psf.offsets_px
    return np.asarray(np.exp(-(x**2 + (x**2)[:, None]) / (2 * sigma**2)).ravel())


def _ellipse(psf: Psf, h: Array, weight: Array) -> Array:
    """(b, 2): ellipticity 1 - b/a and angle (degrees, x towards y) of the weighted second moments of PSFs (b, k^2)."""
    x = np.tile(psf.offsets_px, psf.k)
    y = np.repeat(psf.offsets_px, psf.k)
    w = weight * h
    moments = w @ np.column_stack([x, y, x * x, x * y, y * y]) / w.sum(axis=1, keepdims=True)
    cx, cy, xx, xy, yy = moments.T
    xx, xy, yy = xx - cx * cx, xy - cx * cy, yy - cy * cy
    spread = np.hypot((xx - yy) / 2, xy)
    minor, major = (xx + yy) / 2 - spread, (xx + yy) / 2 + spread
    flat = 1 - np.sqrt(np.where(minor > 0, minor, np.nan) / major)
    return np.column_stack([flat, np.degrees(np.arctan2(2 * xy, xx - yy) / 2)])


def _strehl(psf: Psf, diffraction: Diffraction, n: int) -> Quantity:
    """Value of the PSF at its centre over that of diffraction alone, both limited to the s grid's band.

    The measured PSF holds the pixel's aperture and the optical low-pass filter too: it is the camera's ratio, not
    the lens's.
    """
    f = (np.arange(256) + 0.5) / 256 * psf.s - psf.s / 2
    ideal = diffraction.otf(np.hypot(f, f[:, None])).mean()
    centre = psf.k**2 // 2
    scale = 1 / float(ideal)
    return Quantity(
        float(psf.h.ravel()[centre] * scale),
        "1",
        float(np.sqrt(psf.covariance[centre, centre]) * scale),
        f"centre sample over diffraction at f/{diffraction.f_number:g}, {diffraction.wavelength_nm:g} nm",
        n,
    )
