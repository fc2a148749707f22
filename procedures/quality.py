"""What a PSF says about a camera: OTF, MTF and the numbers drawn from them, each with its standard uncertainty.

Every number is of the whole PSF, support and tail, and a smooth function of its parameters; its uncertainty is the
linear propagation of their covariance (the tests hold it against Monte Carlo), and its gradient is kept, for those who
take the uncertainty apart. Frequencies are in cycles per pixel of the plane, lengths in its pixels.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from procedures.numerics.bessel import j1
from procedures.numerics.kernel_tail import SHAPES, tail_spectra
from procedures.outcome import Quantity
from procedures.psf import Psf

Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]
Indices = npt.NDArray[np.intp]

STEPS_PER_CYCLE = 50
"""Frequencies of the curves per cycle/pixel."""
DIRECTIONS = 16
"""Directions of the radial mean over half a turn, an even number."""
ROUGHNESS = 0.25
"""How far a true tail strays from the fitted one, ring by ring, over its density: rings of a small aperture, spikes of
an iris. On tails of Airy's disc, defocus, coma and polygons it was 0.1 to 0.3, of spikes up to 1."""
NARROWER = (0.67, 0.75, 0.85)
"""Shares of the band within which a number is drawn again: half of the most that the rest changes is doubt of what
lies beyond the band. The photosite's OTF changes sign: one share alone can hit on a balance."""
FINE = 4
"""Points per sample between which the energy inside a circle is summed."""
AROUND = 4
"""Samples around the support that its interpolation needs."""
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
    gradients : mapping of str to (k^2 + q,) float64
        Of each number by the PSF's parameters.
    budgets : mapping of str to mapping of str to float
        Standard uncertainties that make up that of each number: "noise" what the PSF's covariance gives, "choice" what
        the support and the band leave open; see `procedures.budget`.
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
    gradients: Mapping[str, Array]
    budgets: Mapping[str, Mapping[str, float]]


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

    @property
    def tail_density_px(self) -> float:
        """A of the mean far tail a / r^3 per square pixel, r in pixels, whatever the aberrations: 1 / (pi^3 f_c).

        Source: the OTF's slope at 0 is -4 / (pi f_c) for a circular pupil.
        """
        return 1 / (np.pi**3 * self.cutoff)

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
    """The optical transfer function of the whole PSF at frequencies (fx, fy) of any common shape; 1 at the origin."""
    fx, fy = np.broadcast_arrays(fx, fy)
    values = psf.spectra(fx.ravel(), fy.ravel()) @ psf.parameters
    return np.asarray(values.reshape(fx.shape) / psf.light)


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
    f = frequencies(psf)
    zero = np.zeros_like(f)
    horizontal, vertical = psf.spectra(f, zero), psf.spectra(zero, f)
    mtf_h, slope_h = _modulus(psf, horizontal)
    mtf_v, slope_v = _modulus(psf, vertical)
    mtf_r, slope_r = _radial_mean(psf, f)
    curves = {"horizontal": (mtf_h, slope_h), "vertical": (mtf_v, slope_v), "radial": (mtf_r, slope_r)}
    found: list[_Found] = []
    for name, (mtf, slope) in curves.items():
        found += _curve_numbers(f, mtf, slope, name)
    found += _spatial_numbers(psf)
    if diffraction is not None:
        found.append(_strehl(psf, diffraction))
    C = psf.parameter_covariance
    gradients = {one.name: one.gradient for one in found}
    uncertainties = dict(zip(gradients, _uncertainty(C, np.array(list(gradients.values()))), strict=True))
    left_open = _left_open(psf, f, curves, uncertainties, found, diffraction)
    told = [one for one in found if np.isfinite(one.value) and np.isfinite(uncertainties[one.name])]
    budgets = {one.name: {"noise": float(uncertainties[one.name]), "choice": left_open[one.name]} for one in told}
    numbers = {
        one.name: Quantity(one.value, one.unit, float(np.linalg.norm(list(budgets[one.name].values()))), one.method, n)
        for one in told
    }
    p, light, stray = psf.parameters, psf.light, _stray(psf, f)
    bands = (np.hypot(_uncertainty(C, slope), stray) for _, slope in curves.values())
    of_h, of_v, of_r = bands
    return Quality(
        f,
        *(mtf_h, of_h, mtf_v, of_v, mtf_r, of_r),
        horizontal @ p / light,
        vertical @ p / light,
        numbers,
        {one.name: one.gradient for one in told},
        budgets,
    )


def truncation(psf: Psf) -> float:
    """Standard uncertainty of the OTF from what the tail's few shapes leave out, at frequencies that the support holds.

    A tail of energy E outside a radius R has the density E R / (2 pi r^3). If the true one strays from it by a share of
    `ROUGHNESS`, alike over a square pixel and independently from the next, the OTF strays by
    ROUGHNESS E sqrt(pi / 2) / (2 pi R).
    """
    share, _ = psf.energy_outside
    radius = psf.k / 2 / psf.s
    return ROUGHNESS * abs(share) * float(np.sqrt(np.pi / 2)) / (2 * np.pi * radius)


def _stray(psf: Psf, f: Array) -> Array:
    """The truncation's uncertainty at frequencies (n,): none at 0, where all light is counted."""
    radius = psf.k / 2 / psf.s
    return np.asarray(truncation(psf) * (1 - np.exp(-((np.pi * f * radius) ** 2))))


def _left_open(
    psf: Psf,
    f: Array,
    curves: Mapping[str, tuple[Array, Array]],
    uncertainties: Mapping[str, float],
    found: list[_Found],
    diffraction: Diffraction | None,
) -> dict[str, float]:
    """What the support (of the curves' numbers) and the band (of the spatial ones) leave open, by number."""
    stray = truncation(psf)
    left = {one.name: 0.0 for one in found}
    for name, (mtf, _) in curves.items():
        left[f"mtf_nyquist_{name}"] = stray
        if (number := f"mtf50_{name}") in left:
            i = int(np.clip(np.searchsorted(-mtf, -0.5), 1, len(f) - 1))
            left[number] = stray * float(f[i] - f[i - 1]) / max(float(mtf[i - 1] - mtf[i]), 1e-9)
    values = {one.name: one.value for one in found}
    for share in NARROWER:
        for name, value in _within_band(psf, share, diffraction).items():
            beyond = (values[name] - value) ** 2 - uncertainties[name] ** 2
            if np.isfinite(beyond):
                left[name] = max(left[name], 0.5 * float(np.sqrt(max(beyond, 0.0))))
    return left


def frequencies(psf: Psf) -> Array:
    """Where the curves are drawn: 0 to s/2 cycles/pixel."""
    return np.linspace(0, psf.s / 2, int(STEPS_PER_CYCLE * psf.s / 2) + 1)


def mtf_along(psf: Psf, f: Array, angle: float) -> tuple[Array, Array]:
    """|OTF| at frequencies f (n,) along a direction (radians from x towards y), and its derivative (n, k^2 + q)."""
    return _modulus(psf, psf.spectra(f * np.cos(angle), f * np.sin(angle)))


def mtf50_along(psf: Psf, angle: float) -> tuple[float, Array] | None:
    """MTF50 along a direction in cycles/pixel, and its derivative by the PSF's parameters; None without."""
    f = frequencies(psf)
    return _crossing(f, *mtf_along(psf, f, angle))


def quantity_along(psf: Psf, angle_deg: float, n: int) -> Quantity | None:
    """MTF50 along a direction, degrees from x towards y, with its uncertainty; None where the MTF stays above 1/2."""
    found = mtf50_along(psf, float(np.radians(angle_deg)))
    if found is None:
        return None
    value, gradient = found
    uncertainty = float(_uncertainty(psf.parameter_covariance, gradient[None])[0])
    return Quantity(value, "cycles/pixel", uncertainty, f"|OTF| = 0.5 at {angle_deg:.1f} degrees from x", n)


def energy_within(psf: Psf, radius_px: float) -> tuple[float, Array]:
    """Share of all light within a radius about the centre, of the band-limited PSF, and its derivative (k^2 + q,)."""
    image, light = psf.extended(), psf.light
    size = min(2 * (int(np.ceil(radius_px * psf.s)) + AROUND) + 1, len(image))
    rim = (len(image) - size) // 2
    M, r, _ = _fine_grid(size, psf.s)
    weight = (np.clip((radius_px - r) * FINE * psf.s + 0.5, 0, 1) / FINE**2).reshape(len(M), len(M))
    by_image = np.zeros_like(image)
    by_image[rim : len(image) - rim, rim : len(image) - rim] = M.T @ weight @ M
    share = float(np.sum(by_image * image)) / light
    return share, (psf.contract(by_image) - share * psf.weights) / light


def energy_above_nyquist(psf: Psf) -> tuple[float, Array]:
    """Share of |OTF|^2 outside |fx|, |fy| <= 1/2, what noise adds taken away, and its derivative (k^2 + q,)."""
    image = psf.extended()
    S = _nyquist_kernel(len(image), psf.s)
    noise = _noise_of_energy(psf)
    through = S @ image @ S
    inside, whole = float(np.sum(through * image)) - noise[0], float(np.sum(image**2)) - noise[1]
    if whole <= 0:
        return np.nan, np.full(len(psf.parameters), np.nan)
    return 1 - inside / whole, psf.contract(2 * (inside / whole * image - through) / whole)


@dataclass(frozen=True)
class _Found:
    """A number as it is drawn from a PSF: its name, value, unit, method, and its gradient by the parameters."""

    name: str
    value: float
    unit: str
    method: str
    gradient: Array


def _modulus(psf: Psf, waves: Complex) -> tuple[Array, Array]:
    """|OTF| (n,) and its derivative by the parameters (n, k^2 + q), from the parameters' spectra."""
    light = psf.light
    value = waves @ psf.parameters / light
    modulus = np.abs(value)
    phase = np.conj(value) / np.maximum(modulus, 1e-12)
    return modulus, (np.real(phase[:, None] * waves) - modulus[:, None] * psf.weights) / light


@lru_cache(maxsize=8)
def _tail_fan(s: int, k: int) -> Array:
    """Spectra of the tail's shapes at the curves' frequencies in all directions of the radial mean: (n, d, q)."""
    f = np.linspace(0, s / 2, int(STEPS_PER_CYCLE * s / 2) + 1)
    turn = np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    fx, fy = f[:, None] * np.cos(turn), f[:, None] * np.sin(turn)
    return tail_spectra(fx.ravel() / s, fy.ravel() / s, k).reshape(*fx.shape, len(SHAPES))


def _radial_mean(psf: Psf, f: Array) -> tuple[Array, Array]:
    """Mean of |OTF| over directions (n,), and its derivative (n, k^2 + q)."""
    direction = np.arange(DIRECTIONS)
    step = np.exp(-2j * np.pi / psf.s * f[:, None] * np.cos(np.pi * direction / DIRECTIONS))
    powers = np.cumprod(np.broadcast_to(step[..., None], (*step.shape, psf.k // 2)), axis=2)
    ex = np.concatenate([powers[..., ::-1].conj(), np.ones((*step.shape, 1)), powers], axis=2)  # (n, directions, k)
    ey = ex[:, np.abs(DIRECTIONS // 2 - direction)]  # the sine of a direction is the cosine of another
    value = np.sum((ey.reshape(-1, psf.k) @ psf.h).reshape(ex.shape) * ex, axis=2)
    q = len(psf.tail.amplitudes)
    fan = _tail_fan(psf.s, psf.k)[..., :q] if q else np.zeros((*step.shape, 0))
    value = value + fan @ psf.tail.amplitudes
    modulus = np.abs(value)
    phase = np.conj(value) / np.maximum(modulus, 1e-12)
    turned = phase[..., None] * ey
    # the real part of the sum over directions of turned[y] ex[x], as one product of real matrices
    left, right = np.concatenate([turned.real, -turned.imag], axis=1), np.concatenate([ex.real, ex.imag], axis=1)
    inside = (left.transpose(0, 2, 1) @ right / DIRECTIONS).reshape(len(f), -1)
    outside = np.mean(phase.real[..., None] * fan, axis=1)
    mean = modulus.mean(axis=1) / psf.light
    return mean, (np.hstack([inside, outside]) - mean[:, None] * psf.weights) / psf.light


def _uncertainty(C: Array, slope: Array) -> Array:
    """Standard uncertainty of quantities whose derivatives are the rows of `slope`, for parameters' covariance C."""
    return np.asarray(np.sqrt(np.maximum(np.einsum("ij,ij->i", slope @ C, slope), 0)))


def _curve_numbers(f: Array, mtf: Array, slope: Array, name: str) -> list[_Found]:
    """MTF50 and MTF at Nyquist of one curve; no MTF50 where the curve stays above one half."""
    i = int(np.searchsorted(f, 0.5))
    found = [_Found(f"mtf_nyquist_{name}", float(mtf[i]), "1", "|OTF| at 0.5 cycles/pixel", slope[i])]
    crossing = _crossing(f, mtf, slope)
    if crossing is not None:
        found.append(_Found(f"mtf50_{name}", crossing[0], "cycles/pixel", "first crossing of |OTF| = 0.5", crossing[1]))
    return found


def _crossing(f: Array, mtf: Array, slope: Array) -> tuple[float, Array] | None:
    """Where a curve first falls below one half, and the derivative of that; None where it stays above.

    Between the frequencies the curve is a parabola through three of them: a straight line errs by up to 5e-4.
    """
    below = np.flatnonzero(mtf < 0.5)
    if not len(below):
        return None
    i = max(int(below[0]), 2)
    step = f[1] - f[0]
    a, b, c = mtf[i - 2 : i + 1]
    bend, tilt = (a - 2 * b + c) / 2, (c - a) / 2
    t = 0.0 if b == 0.5 else _root(bend, tilt, b - 0.5)
    weights = np.array([t * (t - 1) / 2, 1 - t * t, t * (t + 1) / 2])
    steepness = -(tilt + 2 * bend * t) / step
    return float(f[i - 1] + t * step), np.asarray(weights @ slope[i - 2 : i + 1] / steepness)


def _root(bend: float, tilt: float, above: float) -> float:
    """The root of bend t^2 + tilt t + above that is nearest to 0, on a falling curve."""
    discriminant = max(tilt * tilt - 4 * bend * above, 0.0)
    return float(2 * above / (-tilt + np.sqrt(discriminant)))


def _spatial_numbers(psf: Psf) -> list[_Found]:
    """Width, shape, energy: the numbers read from the band-limited PSF itself."""
    x = psf.offsets_px
    above, slope = energy_above_nyquist(psf)
    found = [
        _of_support(psf, "centroid_x_support", np.tile(x, psf.k)),
        _of_support(psf, "centroid_y_support", np.repeat(x, psf.k)),
        _width(psf, "fwhm_horizontal", 1),
        _width(psf, "fwhm_vertical", 0),
        _Found("energy_above_nyquist", above, "1", "share of |OTF|^2", slope),
    ]
    return [*found, *_encircled(psf, (0.5, 0.8)), *_ellipse_numbers(psf)]


def _within_band(psf: Psf, share: float, diffraction: Diffraction | None) -> dict[str, float]:
    """The numbers that hang on the band's outer frequencies, from the samples low-passed to a share of the band."""
    n = np.arange(psf.k)
    low = share * np.sinc(share * (n[:, None] - n))
    narrow = Psf(low @ psf.h @ low.T, psf.s, psf.covariance, psf.tail)
    found = [_width(narrow, "fwhm_horizontal", 1), _width(narrow, "fwhm_vertical", 0), *_encircled(narrow, (0.5, 0.8))]
    if diffraction is not None:
        found.append(_strehl(narrow, diffraction))
    return {one.name: one.value for one in found}


def _of_support(psf: Psf, name: str, x: Array) -> _Found:
    """The first moment over the support, which alone has one: a tail of 1/r^3 has none."""
    h = psf.h.ravel()
    total = h.sum()
    value = float(h @ x / total)
    gradient = np.concatenate([(x - value) / total, np.zeros(len(psf.parameters) - psf.k**2)])
    return _Found(name, value, "pixel", "first moment inside the support, from the PSF's centre", gradient)


def energy_outside_support(psf: Psf, n: int) -> Quantity:
    """The share of all light outside the support: of this support, not of the camera."""
    share, uncertainty = psf.energy_outside
    return Quantity(share, "1", uncertainty, "share of all light outside the support", n)


def _width(psf: Psf, name: str, axis: int) -> _Found:
    """Full width at half maximum of the band-limited section through the centre, along rows (1) or columns (0)."""
    middle = psf.k // 2
    profile = psf.h[middle] if axis else psf.h[:, middle]
    used = middle * psf.k + np.arange(psf.k) if axis else middle + psf.k * np.arange(psf.k)
    steps = 1e-4 * max(float(np.abs(profile).max()), 1e-30) * np.eye(psf.k)
    value = float(_widths(profile[None], psf.s)[0])
    slope = (_widths(profile + steps, psf.s) - _widths(profile - steps, psf.s)) / (2 * steps[0, 0])
    gradient = np.zeros(len(psf.parameters))
    gradient[used] = slope
    return _Found(name, value, "pixel", "band-limited section through the centre", gradient)


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


def _nyquist_kernel(size: int, s: int) -> Array:
    """(size, size): the quadratic form S h S . h is the integral of |OTF|^2 over |fx|, |fy| <= 1/2, of sum h^2."""
    return np.asarray(np.sinc((np.arange(size)[:, None] - np.arange(size)) / s) / s)


def _noise_of_energy(psf: Psf) -> tuple[float, float]:
    """What noise of the samples adds, on average, to the energy inside the Nyquist square and to the whole."""
    S = _nyquist_kernel(psf.k, psf.s)
    C = psf.covariance.reshape(psf.k, psf.k, psf.k, psf.k)
    inside = np.einsum("jb,jb->", S, np.einsum("ia,iajb->jb", S, C.transpose(0, 2, 1, 3)))
    return float(inside), float(np.trace(psf.covariance))


@lru_cache(maxsize=8)
def _fine_grid(size: int, s: int) -> tuple[Array, Array, Indices]:
    """Between the samples of an image: the matrix of band-limited interpolation (n, size), the points' distances from
    the centre in pixels (n^2,), and their order by distance."""
    t = (np.arange(FINE * (size - 1) + 1) - FINE * (size // 2)) / FINE
    r = np.hypot(t, t[:, None]).ravel() / s
    return np.sinc(t[:, None] - (np.arange(size) - size // 2)), r, np.argsort(r, kind="stable")


def _encircled(psf: Psf, shares: tuple[float, ...]) -> list[_Found]:
    """Radii about the marks' centre within which shares of all light lie, of the band-limited PSF."""
    whole = psf.extended()
    found = []
    for share in shares:
        one = None
        # most circles lie inside the support: the far samples are only looked at where they must be
        for size in {min(psf.k + 2 * AROUND, len(whole)): None, len(whole): None}:
            one = _circle(psf, whole, size, share)
            if np.isfinite(one.value):
                break
        assert one is not None
        found.append(one)
    return found


def _circle(psf: Psf, whole: Array, size: int, share: float) -> _Found:
    """The radius of a share of all light, by the central samples of the image; NaN where they hold less of it."""
    rim = (len(whole) - size) // 2
    image, light = whole[rim : len(whole) - rim, rim : len(whole) - rim], psf.light
    M, r, order = _fine_grid(size, psf.s)
    cell = 1 / (FINE * psf.s)  # side of a fine point's square, which the circle enters linearly
    fine = (M @ image @ M.T).ravel() / FINE**2
    within = r[order] < (size // 2) / psf.s
    running = np.cumsum(fine[order][within]) / light
    name, method = f"encircled_energy_{share * 100:.0f}", f"radius of {share:.0%} of all light"
    if not len(running) or running.max() < share or running[0] >= share:
        return _Found(name, np.nan, "pixel", method, np.full(len(psf.parameters), np.nan))
    radius, density = float(r[order[np.argmax(running >= share)]]), 1.0
    for _ in range(6):  # Newton's steps on the smooth sum
        density = float(fine[np.abs(radius - r) < cell / 2].sum()) / cell / light
        radius += (share - float(np.clip((radius - r) / cell + 0.5, 0, 1) @ fine) / light) / density
    weight = np.clip((radius - r) / cell + 0.5, 0, 1).reshape(len(M), len(M)) / FINE**2
    by_image = np.zeros_like(whole)
    by_image[rim : len(whole) - rim, rim : len(whole) - rim] = M.T @ weight @ M
    gradient = (share * psf.weights - psf.contract(by_image)) / light / density
    return _Found(name, radius, "pixel", method, gradient)


def _moment_weight(psf: Psf) -> Array:
    """Gaussian weight (k^2,) as wide as the PSF's core: without it the far samples' noise rules the moments."""
    middle = psf.k // 2
    core = _widths(np.stack([psf.h[middle], psf.h[:, middle]]), psf.s)
    sigma = 1.5 * float(np.nanmean(core)) / 2.355 if np.isfinite(core).any() else psf.k / (4 * psf.s)
    x = psf.offsets_px
    return np.asarray(np.exp(-(x**2 + (x**2)[:, None]) / (2 * sigma**2)).ravel())


def _ellipse_numbers(psf: Psf) -> list[_Found]:
    """Ellipticity 1 - b/a, and the major axis' angle, of the second moments under a Gaussian weight."""
    x, y = np.tile(psf.offsets_px, psf.k), np.repeat(psf.offsets_px, psf.k)
    w = _moment_weight(psf)
    monomials = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y]) * w[:, None]
    value, slope = _ellipse(psf.h.ravel() @ monomials)
    gradients = np.zeros((2, len(psf.parameters)))
    gradients[:, : psf.k**2] = slope @ monomials.T
    method = "weighted second moments"
    return [
        _Found("ellipticity", float(value[0]), "1", f"1 - b/a of {method}", gradients[0]),
        _Found("ellipse_angle", float(value[1]), "degree", "major axis, from x towards y", gradients[1]),
    ]


def _ellipse(sums: Array) -> tuple[Array, Array]:
    """Ellipticity and angle in degrees (2,) of weighted sums of 1, x, y, xx, xy, yy, and their derivative (2, 6)."""
    total = sums[0]
    cx, cy, mxx, mxy, myy = sums[1:] / total
    xx, xy, yy = mxx - cx * cx, mxy - cx * cy, myy - cy * cy
    half, spread = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    minor, major = half - spread, half + spread
    if not (minor > 0 and spread > 0):
        return np.full(2, np.nan), np.full((2, 6), np.nan)
    # by the central moments first: half and spread, then minor and major
    of_spread = np.array([(xx - yy) / 4, xy, (yy - xx) / 4]) / spread
    of_half = np.array([0.5, 0.0, 0.5])
    flat = -np.sqrt(minor / major) / 2 * ((of_half - of_spread) / minor - (of_half + of_spread) / major)
    turn = np.degrees(np.array([-xy / 2, (xx - yy) / 2, xy / 2]) / (2 * spread**2))
    central = np.array(
        [
            [2 * cx * cx - mxx, -2 * cx, 0, 1, 0, 0],
            [2 * cx * cy - mxy, -cy, -cx, 0, 1, 0],
            [2 * cy * cy - myy, 0, -2 * cy, 0, 0, 1],
        ]
    )
    value = np.array([1 - np.sqrt(minor / major), np.degrees(np.arctan2(2 * xy, xx - yy) / 2)])
    return value, np.stack([flat, turn]) @ central / total


def _strehl(psf: Psf, diffraction: Diffraction) -> _Found:
    """Value of the PSF at its centre over that of diffraction alone, both limited to the s grid's band.

    The measured PSF holds the pixel's aperture and the optical low-pass filter too: it is the camera's ratio, not
    the lens's.
    """
    f = (np.arange(256) + 0.5) / 256 * psf.s - psf.s / 2
    ideal = float(diffraction.otf(np.hypot(f, f[:, None])).mean())
    centre = psf.k**2 // 2
    value = float(psf.h.ravel()[centre]) / psf.light / ideal
    gradient = -value * psf.weights / psf.light
    gradient[centre] += 1 / psf.light / ideal
    method = f"centre over diffraction at f/{diffraction.f_number:g}, {diffraction.wavelength_nm:g} nm"
    return _Found("strehl", value, "1", method, gradient)
