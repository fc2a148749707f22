"""Sharpness metrics (OTF, MTF, FWHM, Strehl ratio) of a PSF, each with its standard uncertainty.

Every number is a smooth function of the parameters of the whole PSF, support and tail. Its uncertainty is the linear
propagation of their covariance (verified by Monte Carlo in the tests); its gradient is kept for uncertainty budgets.
Frequencies are in cycles per pixel of the plane, lengths in its pixels.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from procedures.display import axes_of, html, summary
from procedures.numbers import (
    CYCLES,
    ENERGY_ABOVE_NYQUIST,
    FWHM_HORIZONTAL,
    FWHM_VERTICAL,
    STREHL,
    frequency_of,
    name_at,
)
from procedures.numerics.arrays import Array, Complex
from procedures.numerics.kernel_tail import EXCHANGED, MIRRORED, SHAPES, tail_spectra
from procedures.numerics.transforms import j1
from procedures.outcome import BadParameter, Check, Quantity, Verdict, checked_type
from procedures.psf import Psf, curve_model_error, tail_energy_uncertainty
from procedures.psf_origin import Origin, about, about_origin
from procedures.spatial_numbers import (
    CIRCLES,
    DrawnNumber,
    centred_numbers,
    circle,
    energy_beyond_band,
    first_moments,
    name_of_circle,
    section_widths,
    whole_numbers,
)
from procedures.transfer_function import NYQUIST, curve_numbers, first_crossing

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Indices = npt.NDArray[np.intp]

STEPS_PER_CYCLE = 50  # frequencies of the curves per cycle/pixel
KNOTS = slice(5, None, 5)
"""Frequencies of the curves at which uncertainty budgets are computed; in between they are interpolated."""
STEP = 0.005  # half the interval around a crossing over which a curve's slope is taken, in cycles per pixel
SUM_TOLERANCE = 0.1  # of the sum of the samples, which noise changes
DIRECTIONS = 16  # directions of the radial mean over half a turn, a multiple of four
NARROW_BANDS = (0.67, 0.75, 0.85)
"""Shares of the band with which a number is computed again: half of the largest change is its uncertainty by missing
frequencies. Several shares are used, as the photosite's OTF changes sign and a single change may vanish."""
MAX_EXCESS, EXCESS_SIGMAS = 0.02, 4.0
"""Excess of an MTF over the diffraction limit, absolute and in standard uncertainties, above which it is flagged;
colour and pupil differ from the nominal ones by a few per cent."""
WAVELENGTHS_NM = {"R": 600.0, "G": 530.0, "B": 460.0, "Y": 550.0}
"""Wavelength of maximum sensitivity of a plane with common colour filters."""


@dataclass(frozen=True)
class Quality:
    """Curves and numbers of one PSF.

    frequencies : (n,) 0 to s/2 cycles/pixel
    mtf_horizontal, mtf_vertical, mtf_radial : (n,) |OTF| along x, along y, and its mean over directions
    curve_budgets : uncertainty budget of each curve: "horizontal", "vertical", "radial"
    otf_horizontal, otf_vertical : (n,) complex128 OTF relative to the PSF's centre
    gradients : derivative of each number by the PSF's parameters, and of the curves at the frequencies `KNOTS`
    budgets : uncertainty budget of each number: "noise" from the PSF's covariance, "choice" from the finite support and
        band; see `procedures.choice`
    at : requested frequencies of the MTF
    origin : "centre", "marks", "centroid" or "peak"; the point about which widths, encircled energies and the Strehl
        ratio are taken
    """

    frequencies: Array
    mtf_horizontal: Array
    mtf_vertical: Array
    mtf_radial: Array
    otf_horizontal: Complex
    otf_vertical: Complex
    numbers: Mapping[str, Quantity]
    gradients: Mapping[str, Array]
    budgets: Mapping[str, Mapping[str, float]]
    curve_budgets: Mapping[str, Mapping[str, Array]]
    at: tuple[float, ...] = ()
    origin: Origin = "centre"

    __repr__ = summary
    _repr_html_ = html

    def uncertainty(self, direction: str, without: str = "") -> Array:
        """Standard uncertainty (n,) of the curve "horizontal", "vertical" or "radial", one term excluded."""
        terms = [term for name, term in self.curve_budgets[direction].items() if name != without]
        return np.asarray(np.sqrt(sum(term**2 for term in terms)))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the MTF along x, along y and its radial mean, with one standard uncertainty."""
        ax = axes_of(ax)
        for name in self.curve_budgets:
            mtf, sigma = getattr(self, f"mtf_{name}"), self.uncertainty(name)
            (line,) = ax.plot(self.frequencies, mtf, label=name)
            ax.fill_between(self.frequencies, mtf - sigma, mtf + sigma, color=line.get_color(), alpha=0.3, linewidth=0)
        ax.set(xlabel="frequency / (cycles/pixel)", ylabel="MTF", ylim=(0, 1.05))
        ax.legend()
        return ax


PRINT_BLUR = "print blur"
"""Term of the budget: blur of the chart's print, which one photograph cannot distinguish from that of the lens."""
CAMERA, OPERATOR = "camera", "operator"  # sources of an f-number
CUTOFFS = (1e-3, 1e3)  # plausible range of the diffraction cutoff, in cycles/pixel


@dataclass(frozen=True)
class Diffraction:
    """Diffraction limit of a plane.

    pixel_pitch_um : float, pitch of the *plane's* pixels (twice the sensor's for a Bayer plane), in micrometres
    stated_by : str, source of the f-number: `CAMERA`, or `OPERATOR` where the camera recorded none or another
    """

    f_number: float
    pixel_pitch_um: float
    wavelength_nm: float
    stated_by: str = CAMERA

    def __post_init__(self) -> None:
        f, pitch, wave = self.f_number, self.pixel_pitch_um, self.wavelength_nm
        if not (min(f, pitch, wave) > 0 and CUTOFFS[0] <= self.cutoff <= CUTOFFS[1]):
            low, high = CUTOFFS
            reason = (
                f"the diffraction cutoff must be {low:g} to {high:g} cycles/pixel; got f/{f:g}, a pixel pitch of "
                f"{pitch:g} um and a wavelength of {wave:g} nm"
            )
            raise BadParameter(reason, "check f-number, pixel pitch and wavelength")

    @property
    def typed(self) -> bool:
        """Whether the operator gave the f-number."""
        return self.stated_by == OPERATOR

    @property
    def cutoff(self) -> float:
        """Cutoff frequency of the aperture, in cycles per pixel: pitch / (lambda N)."""
        return self.pixel_pitch_um / (self.wavelength_nm * 1e-3 * self.f_number)

    @property
    def tail_density_px(self) -> float:
        """Coefficient a of the far tail a / r^3 per square pixel, for any aberrations: 1 / (pi^3 f_c), from the OTF's
        slope."""
        return 1 / (np.pi**3 * self.cutoff)

    def psf(self, r: Array) -> Array:
        """Diffraction-limited PSF of unit volume at distances r (pixels). Source: thesis, section 2.2.1: the Airy
        pattern."""
        x = np.pi * self.cutoff * np.asarray(r, dtype=np.float64)
        small = np.abs(x) < 1e-6
        ring = np.where(small, 0.5, j1(np.where(small, 1.0, x)) / np.where(small, 1.0, x))
        return np.asarray(np.pi * self.cutoff**2 * ring**2)

    def otf(self, f: Array) -> Array:
        """Diffraction-limited OTF at frequencies f (cycles/pixel)."""
        v = np.clip(np.abs(f) / self.cutoff, 0, 1)
        return np.asarray(2 / np.pi * (np.arccos(v) - v * np.sqrt(1 - v * v)))


def otf(psf: Psf, fx: Array, fy: Array) -> Complex:
    """Optical transfer function of the whole PSF at frequencies (fx, fy) of any common shape; 1 at the origin."""
    fx, fy = np.broadcast_arrays(fx, fy)
    values = psf.spectra(fx.ravel(), fy.ravel()) @ psf.parameters
    return np.asarray(values.reshape(fx.shape) / psf.light)


def assess(
    psf: Psf, *, n: int, diffraction: Diffraction | None = None, at: Sequence[float] = (), unconverged: float = 0.0,
    origin: Origin = "centre",
) -> Quality:  # fmt: skip
    """Compute the curves and numbers of a PSF.

    n : int, number of samples from which the PSF was estimated, for the record
    diffraction : Diffraction, diffraction limit; with it the Strehl ratio is reported too
    at : sequence of float
        Further frequencies, in cycles per pixel of the plane, at which the MTF is reported; none beyond s/2.
    unconverged : float, relative change of the frequencies that is expected if k is raised
    origin : "centre", "marks", "centroid" or "peak"
        The point about which widths, encircled energies and the Strehl ratio are taken.
    """
    checked_type(psf, Psf, "pass the psf of an estimate, outcome.result().psf, or field.at(x, y)")
    if not abs(psf.h.sum() - 1) < SUM_TOLERANCE:
        raise BadParameter(f"the samples of a PSF have the sum 1; got {psf.h.sum():g}", "divide them by their sum")
    f = frequencies(psf)
    zero = np.zeros_like(f)
    horizontal, vertical = psf.spectra(f, zero), psf.spectra(zero, f)
    mtf_h, slope_h = _modulus(psf, horizontal)
    mtf_v, slope_v = _modulus(psf, vertical)
    mtf_r, slope_r = _radial_mean(psf, f)
    curves = {"horizontal": (mtf_h, slope_h), "vertical": (mtf_v, slope_v), "radial": (mtf_r, slope_r)}
    C = psf.parameter_covariance
    numbers_drawn: list[DrawnNumber] = []
    gradients: dict[str, Array] = {}
    curve_budgets, open_parts = {}, dict[str, float]()
    for name, (mtf, slope) in curves.items():
        of_curve = list(curve_numbers(f, mtf, slope, name, at))
        fall = -np.gradient(mtf, f)
        choice = np.hypot(curve_model_error(psf, f, mtf, slope), unconverged * f * fall)
        curve_budgets[name] = {"noise": _uncertainty(C, slope), "choice": choice}
        open_parts |= _read_from_curve(of_curve, f, choice, fall)
        gradients |= {name_at(f[i], name): slope[i] for i in range(len(f))[KNOTS]}
        numbers_drawn += of_curve

    def centred(moved: Psf) -> list[DrawnNumber]:
        return centred_numbers(moved) + ([_strehl(moved, diffraction)] if diffraction is not None else [])

    of_space = [*first_moments(psf), *about_origin(psf, origin, centred), *whole_numbers(psf)]
    numbers_drawn += of_space
    uncertainties = dict(
        zip(
            (one.name for one in numbers_drawn),
            _uncertainty(C, np.array([one.gradient for one in numbers_drawn])),
            strict=True,
        )
    )
    open_parts |= _finite_grid_uncertainty(about(psf, origin), uncertainties, of_space, diffraction)
    reported = [one for one in numbers_drawn if np.isfinite(one.value) and np.isfinite(uncertainties[one.name])]
    budgets = {one.name: {"noise": float(uncertainties[one.name]), "choice": open_parts[one.name]} for one in reported}
    numbers = {
        one.name: Quantity(one.value, one.unit, float(np.linalg.norm(list(budgets[one.name].values()))), one.method, n)
        for one in reported
    }
    return Quality(
        f, *(mtf_h, mtf_v, mtf_r), horizontal @ psf.parameters / psf.light, vertical @ psf.parameters / psf.light,
        numbers, gradients | {one.name: one.gradient for one in reported}, budgets, curve_budgets, tuple(at), origin,
    )  # fmt: skip


def _read_from_curve(numbers: Sequence[DrawnNumber], f: Array, uncertainty: Array, fall: Array) -> dict[str, float]:
    """An uncertainty of a curve as that of the numbers read from it; `fall` is the negative derivative of the curve."""
    parts = {}
    for number in numbers:
        crossed, known = number.unit == CYCLES, frequency_of(number.name)
        place = number.value if crossed else known[0] if known else NYQUIST
        steepness = max(float(np.interp(place, f, fall)), 1e-9) if crossed else 1.0
        parts[number.name] = float(np.interp(place, f, uncertainty)) / steepness
    return parts


def _finite_grid_uncertainty(
    psf: Psf, uncertainties: Mapping[str, float], numbers_drawn: list[DrawnNumber], diffraction: Diffraction | None
) -> dict[str, float]:
    """Uncertainty of each spatial number by the finite band and the energy outside the support."""
    parts = {one.name: 0.0 for one in numbers_drawn}
    values = {one.name: one.value for one in numbers_drawn}
    for share in NARROW_BANDS:
        for name, value in _within_band(psf, share, diffraction).items():
            beyond = (values[name] - value) ** 2 - uncertainties[name] ** 2
            if np.isfinite(beyond):
                parts[name] = max(parts[name], 0.5 * float(np.sqrt(max(beyond, 0.0))))
    parts[ENERGY_ABOVE_NYQUIST] = energy_beyond_band(
        psf, values[ENERGY_ABOVE_NYQUIST], uncertainties[ENERGY_ABOVE_NYQUIST]
    )
    for name, changes in _tail_energy_changes(psf, numbers_drawn).items():
        parts[name] = float(np.hypot(parts[name], changes))
    return parts


def _tail_energy_changes(psf: Psf, numbers_drawn: list[DrawnNumber]) -> dict[str, float]:
    """Change of the numbers by the uncertainty of the energy outside the support, assumed to be of the mean tail."""
    if not len(psf.tail.amplitudes):
        return {}
    mean_tail = psf.k**2  # index of its amplitude
    share = tail_energy_uncertainty(psf) * psf.light / float(psf.weights[mean_tail])
    changes = {one.name: share * abs(float(one.gradient[mean_tail])) for one in numbers_drawn}
    return {name: value for name, value in changes.items() if np.isfinite(value)}


def frequencies(psf: Psf) -> Array:
    """Frequencies of the curves: 0 to s/2 cycles/pixel."""
    return np.linspace(0, psf.s / 2, int(STEPS_PER_CYCLE * psf.s / 2) + 1)


def mtf_along(psf: Psf, f: Array, angle: float) -> tuple[Array, Array]:
    """|OTF| at frequencies f (n,) along a direction (radians from x towards y), and its derivative (n, k^2 + q)."""
    return _modulus(psf, psf.spectra(f * np.cos(angle), f * np.sin(angle)))


def mtf50_along(psf: Psf, angle: float) -> tuple[float, Array] | None:
    """MTF50 along a direction in cycles/pixel, and its derivative by the parameters; None where the MTF stays above."""
    return first_crossing(frequencies(psf), lambda f: mtf_along(psf, f, angle))


def quantity_along(psf: Psf, angle_deg: float, n: int) -> Quantity | None:
    """MTF50 along a direction, degrees from x towards y, with its uncertainty; None where the MTF stays above 1/2."""
    angle = float(np.radians(angle_deg))
    crossed = mtf50_along(psf, angle)
    if crossed is None:
        return None
    value, gradient = crossed
    noise = float(_uncertainty(psf.parameter_covariance, gradient[None])[0])
    uncertainty = float(np.hypot(noise, crossing_model_error(psf, value, lambda f: mtf_along(psf, f, angle))))
    return Quantity(value, "cycles/pixel", uncertainty, f"|OTF| = 0.5 at {angle_deg:.1f} degrees from x", n)


def crossing_model_error(
    psf: Psf, frequency: float, curve: Callable[[Array], tuple[Array, Array]], passed: float = 1.0
) -> float:
    """Standard uncertainty of the frequency where an MTF divided by `passed`, with derivatives (n, p), crosses a level,
    by the tail's model error."""
    f = frequency + np.array([-STEP, 0, STEP])
    value, slope = curve(f)
    error = curve_model_error(psf, f[1:2], value[1:2] * passed, slope[1:2], passed)
    return float(error[0]) * 2 * STEP / max(float(value[0] - value[2]), 1e-9)


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
    turn = np.pi * np.arange(DIRECTIONS // 4 + 1) / DIRECTIONS
    fx, fy = f[:, None] * np.cos(turn), f[:, None] * np.sin(turn)
    octant = tail_spectra(fx.ravel() / s, fy.ravel() / s, k).reshape(*fx.shape, len(SHAPES))
    direction = np.arange(DIRECTIONS)
    up = np.minimum(direction, DIRECTIONS - direction)  # the others by mirror symmetry
    signs = np.where((up < direction)[:, None], MIRRORED, 1.0)
    signs = signs * np.where((up > DIRECTIONS // 4)[:, None], EXCHANGED, 1.0)
    return np.asarray(octant[:, np.minimum(up, DIRECTIONS // 2 - up)] * signs)


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
    parts, right = np.concatenate([turned.real, -turned.imag], axis=1), np.concatenate([ex.real, ex.imag], axis=1)
    inside = (parts.transpose(0, 2, 1) @ right / DIRECTIONS).reshape(len(f), -1)
    outside = np.mean(phase.real[..., None] * fan, axis=1)
    mean = modulus.mean(axis=1) / psf.light
    return mean, (np.hstack([inside, outside]) - mean[:, None] * psf.weights) / psf.light


def _uncertainty(C: Array, slope: Array) -> Array:
    """Standard uncertainties of quantities with the derivatives `slope`, for the parameters' covariance C."""
    return np.asarray(np.sqrt(np.maximum(np.einsum("ij,ij->i", slope @ C, slope), 0)))


def _within_band(psf: Psf, share: float, diffraction: Diffraction | None) -> dict[str, float]:
    """Numbers that depend on the band's outer frequencies, from samples low-passed to a share of the band."""
    narrow = psf.narrowed(share)
    horizontal, vertical = section_widths(narrow)
    whole = narrow.extended()
    values: dict[str, float] = {FWHM_HORIZONTAL: horizontal, FWHM_VERTICAL: vertical}
    values |= {name_of_circle(part): circle(narrow, whole, part).radius for part in CIRCLES}
    if diffraction is not None:
        values[STREHL] = _strehl(narrow, diffraction).value
    return values


def energy_outside_support(psf: Psf, n: int) -> Quantity:
    """Share of the energy outside the support; it depends on the support, not only on the camera."""
    share, noise = psf.energy_outside
    uncertainty = float(np.hypot(noise, tail_energy_uncertainty(psf)))
    return Quantity(share, "1", uncertainty, "share of all light outside the support", n)


def _strehl(psf: Psf, diffraction: Diffraction) -> DrawnNumber:
    """Value of the PSF at its centre over that of the diffraction limit, both band-limited: the camera's, not the
    lens's, as pixel and low-pass filter are included."""
    f = (np.arange(256) + 0.5) / 256 * psf.s - psf.s / 2
    ideal = float(diffraction.otf(np.hypot(f, f[:, None])).mean())
    if diffraction.cutoff < psf.s / 20:  # too few frequencies lie inside the cutoff, and all of it is in the band
        ideal = float(diffraction.psf(np.zeros(1))[0]) / psf.s**2
    centre = psf.k**2 // 2
    value = float(psf.h.ravel()[centre]) / psf.light / ideal
    gradient = -value * psf.weights / psf.light
    gradient[centre] += 1 / psf.light / ideal
    source = " as typed" if diffraction.typed else ""
    method = f"centre over diffraction at f/{diffraction.f_number:g}{source}, {diffraction.wavelength_nm:g} nm"
    return DrawnNumber(STREHL, value, "1", method, gradient)


def beyond_diffraction(quality: Quality, diffraction: Diffraction | None) -> list[Check]:
    """Check for an MTF above the diffraction limit, which shows a wrong f-number or pixel pitch."""
    if diffraction is None:
        return []
    limit = diffraction.otf(quality.frequencies)
    both = np.array([quality.mtf_horizontal, quality.mtf_vertical])
    # without the print's blur, which only lowers an MTF: it explains none above the limit
    uncertainties = np.array([quality.uncertainty(way, PRINT_BLUR) for way in ("horizontal", "vertical")])
    above = both - MAX_EXCESS - EXCESS_SIGMAS * uncertainties - limit
    way, at = np.unravel_index(np.argmax(above), above.shape)
    measured, most = both[way, at], limit[at]
    reason = (
        f"the MTF at {quality.frequencies[at]:.2f} cycles/pixel is {measured:.2f}, above the diffraction limit "
        f"{most:.2f} of f/{diffraction.f_number:g} and a pixel pitch of {diffraction.pixel_pitch_um:g} um"
    )
    allowed = MAX_EXCESS + EXCESS_SIGMAS * uncertainties[way, at]
    return [Check("diffraction", measured - most, allowed, Verdict.DOUBTFUL, reason, "check f-number and pixel pitch")]
