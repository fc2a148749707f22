"""Model PSF of given parts and parameters on a measured PSF's grid, with derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property, lru_cache

import numpy as np
import scipy.fft

from procedures.numerics.arrays import Array, Complex
from procedures.psf import Psf
from procedures.quality import Diffraction

PERIOD_PX = 16
"""Period of the model in pixels of the plane: the diffraction tail there is 1 / 400 of that at the PSF's rim."""
SMALL = 1e-4
LARGEST_WAVES = 1.0
LARGEST_SHIFT_PX = 1.5


@dataclass(frozen=True, eq=False)
class Grid:
    """Sampling of the PSF, and the known properties of the camera. pitch : sensor pixels per pixel of the plane."""

    psf: Psf
    diffraction: Diffraction
    pitch: int

    @cached_property
    def pupil(self) -> Pupil:
        """The lens pupil, up to the PSF's highest frequency."""
        return Pupil(self.diffraction.cutoff, 1 / PERIOD_PX, self.psf.s / 2)

    @cached_property
    def f(self) -> Array:
        """Frequencies along an axis, (n,), cycles per pixel of the plane."""
        count = PERIOD_PX * self.psf.s // 2
        return np.arange(-count, count + 1) / PERIOD_PX

    @cached_property
    def _waves(self) -> Complex:
        """exp(2 pi i f x) of every sample along an axis, (k, n); the two band limits have weight one half."""
        weight = np.ones(len(self.f))
        weight[[0, -1]] = 0.5
        return np.asarray(np.exp(2j * np.pi * self.psf.offsets_px[:, None] * self.f) * weight)

    def samples(self, otf: Complex) -> Array:
        """Samples (..., k^2) of transfer functions (..., n, n), up to a common factor."""
        values = np.real(self._waves @ otf @ self._waves.T)
        return np.asarray(values.reshape(*otf.shape[:-2], -1))

    def model(self, parts: ModelParts, p: Array) -> tuple[Array, Array]:
        """Samples (k^2,) of sum 1, and their derivatives (k^2, parameters), at `p` in the order of `names_of`."""
        count = len(parts.names)
        fx, fy = self.f[None, :], self.f[:, None]
        shift = np.exp(-2j * np.pi * (fx * p[0] + fy * p[1]))
        values, waves = p[2 : 2 + count], np.zeros(len(TERMS))
        waves[list(parts.aberrations)] = p[2 + count :]
        lens, lens_slopes = self.pupil.otf_and_slopes(waves, parts.aberrations)
        sensor = sensor_otf(parts, values, fx / self.pitch, fy / self.pitch)
        otf = shift * sensor * lens
        slopes = [-2j * np.pi * fx * otf, -2j * np.pi * fy * otf]
        for i in range(count):
            step = SMALL * np.eye(count)[i]
            above, below = (sensor_otf(parts, values + e, fx / self.pitch, fy / self.pitch) for e in (step, -step))
            slopes.append(shift * lens * (above - below) / (2 * SMALL))
        slopes += [shift * sensor * slope for slope in lens_slopes]
        h, J = self.samples(otf), self.samples(np.stack(slopes)).T
        total = h.sum()
        h = h / total
        return h, (J - h[:, None] * J.sum(axis=0)) / total


def names_of(parts: ModelParts) -> tuple[str, ...]:
    """Names of all parameters: shift in pixels of the plane, sensor parameters, aberrations in waves."""
    return ("shift_x", "shift_y", *parts.names, *(TERMS[i] for i in parts.aberrations))


def start_of(parts: ModelParts, even_waves: float, spherical_waves: float) -> Array:
    """Starting values of a fit; even aberrations start off zero, where their derivative vanishes."""
    start = {"defocus": even_waves, "astigmatism": even_waves / 3, "astigmatism_oblique": even_waves / 3}
    start |= {"spherical": spherical_waves, **START}
    return np.array([start.get(name, 0.0) for name in names_of(parts)])


def bounds_of(parts: ModelParts) -> tuple[Array, Array]:
    """Smallest and largest values of all parameters."""
    wide = {
        **BOUNDS,
        "shift_x": (-LARGEST_SHIFT_PX, LARGEST_SHIFT_PX),
        "shift_y": (-LARGEST_SHIFT_PX, LARGEST_SHIFT_PX),
    }
    limits = np.array([wide.get(name, (-LARGEST_WAVES, LARGEST_WAVES)) for name in names_of(parts)])
    return limits[:, 0], limits[:, 1]


# Transfer function of a round pupil with aberrations, and its derivatives: autocorrelation by Fourier transforms.

TERMS = (
    "defocus", "astigmatism_oblique", "astigmatism", "coma_y", "coma_x", "trefoil_y", "trefoil_x", "spherical",
)  # fmt: skip
"""Noll's polynomials 4 to 11, of unit root mean square over the pupil."""
LEAST_ACROSS = 48  # samples across the pupil: the error of the discs' overlap is then 2e-3 of its peak
SUBSAMPLES = 8


@dataclass(frozen=True, eq=False)
class Pupil:
    """A round pupil on a grid, with its autocorrelation at frequencies `step` apart, up to `highest`.

    cutoff : cutoff frequency, cycles per pixel; step, highest : spacing and maximum of the frequencies, cycles per
    pixel.
    """

    cutoff: float
    step: float
    highest: float

    def otf_and_slopes(self, waves: Array, terms: tuple[int, ...]) -> tuple[Complex, list[Complex]]:
        """OTF and its derivatives with respect to the given aberrations, (2 h + 1, 2 h + 1) each."""
        disc, zernikes = self._sampled()
        field = self._field(waves)
        fields = np.stack([field, *(2j * np.pi * zernikes[list(terms)] * field)])
        size = scipy.fft.next_fast_len(2 * fields.shape[-1])  # so that their squares do not wrap round
        amplitude, *changes = scipy.fft.fft(scipy.fft.fft(fields, size, axis=2), size, axis=1)
        slopes = [2 * np.real(np.conj(amplitude) * change) for change in changes]
        # autocorrelations of power spectra (m, size, size) at the requested frequencies, normalised to 1 at zero
        # without aberrations
        powers = np.stack([np.abs(amplitude) ** 2, *slopes])
        finer, count = self._finer, round(self.highest / self.step)
        reach = min(count, (size // 2 - 1) // finer)
        rows = finer * np.arange(-reach, reach + 1)
        half = scipy.fft.rfft(powers, axis=2)[:, :, : finer * reach + 1 : finer]
        # the field's correlation at a shift is the intensity's spectrum at the opposite frequency
        right = scipy.fft.fft(half, axis=1)[:, rows % size] / (size**2 * disc.sum())
        # at zero shift the covered fractions are squared and underestimate the area; elsewhere they represent it
        right[:, reach, 0] *= disc.sum() / np.sum(disc**2)
        correlated = np.zeros((len(powers), 2 * count + 1, 2 * count + 1), dtype=np.complex128)
        inside = slice(count - reach, count + reach + 1)
        correlated[:, inside, inside] = np.concatenate([right[:, ::-1, :0:-1].conj(), right], axis=2)
        otf, *derivatives = correlated
        return otf, derivatives

    def strehl(self, waves: Array) -> float:
        """Strehl ratio: peak of the PSF over that without aberrations, maximised over piston and tilt."""
        return float(np.abs(self._field(waves).sum()) ** 2 / self._sampled()[0].sum() ** 2)

    @property
    def _finer(self) -> int:
        return max(int(np.ceil(LEAST_ACROSS * self.step / self.cutoff)), 1)

    def _sampled(self) -> tuple[Array, Array]:
        return _disc(self.cutoff / 2 / (self.step / self._finer))

    def _field(self, waves: Array) -> Complex:
        """Complex amplitude in the pupil, (n, n)."""
        disc, zernikes = self._sampled()
        return np.asarray(disc * np.exp(2j * np.pi * np.tensordot(waves, zernikes, axes=1)))


@lru_cache(maxsize=16)
def _disc(radius: float) -> tuple[Array, Array]:
    """A disc of given radius in samples, its rim by covered fractions, and the aberrations on it (8, n, n)."""
    half = int(np.ceil(radius)) + 1
    fine = (np.arange(SUBSAMPLES) + 0.5) / SUBSAMPLES - 0.5
    x = np.arange(-half, half + 1)
    points = (x[:, None] + fine).ravel() / radius
    r2 = points**2 + (points**2)[:, None]
    n = len(x)
    disc = (r2 <= 1).reshape(n, SUBSAMPLES, n, SUBSAMPLES).mean(axis=(1, 3))
    return disc, _zernikes(x / radius, (x / radius)[:, None])


def _zernikes(x: Array, y: Array) -> Array:
    """Noll's polynomials 4 to 11 at points of the unit disc and slightly beyond."""
    x, y = np.broadcast_arrays(x, y)
    r2 = x * x + y * y
    return np.stack(
        [
            3**0.5 * (2 * r2 - 1),
            6**0.5 * 2 * x * y,
            6**0.5 * (x * x - y * y),
            8**0.5 * (3 * r2 - 2) * y,
            8**0.5 * (3 * r2 - 2) * x,
            8**0.5 * y * (3 * x * x - y * y),
            8**0.5 * x * (x * x - 3 * y * y),
            5**0.5 * (6 * r2 * r2 - 6 * r2 + 1),
        ]
    )


# --- Transfer functions of the sensor: photosite aperture, optical low-pass filter, charge diffusion ---
# Lengths are in sensor pixels, frequencies in cycles per sensor pixel.


class Aperture(StrEnum):
    """Shape of the photosite: a square, or an L without the corner in a direction, from x towards y, y down."""

    SQUARE = "square"
    L_45 = "L without the corner at 45 degrees"
    L_135 = "L without the corner at 135 degrees"
    L_225 = "L without the corner at 225 degrees"
    L_315 = "L without the corner at 315 degrees"

    @property
    def missing_corner_deg(self) -> int | None:
        """Direction of the missing corner; None for a square."""
        return {"L_45": 45, "L_135": 135, "L_225": 225, "L_315": 315}.get(self.name)


class LowPass(StrEnum):
    """Birefringent low-pass filter: number and direction of the spots."""

    NONE = "none"
    TWO_ALONG_X = "two spots along x"
    TWO_ALONG_Y = "two spots along y"
    FOUR = "four spots"


@dataclass(frozen=True)
class ModelParts:
    """The parts of a model, besides diffraction and a shift.

    diffusion : whether charge diffuses, as a Gaussian; aberrations : indices of `pupil.TERMS` that are free.
    """

    aperture: Aperture = Aperture.SQUARE
    low_pass: LowPass = LowPass.NONE
    diffusion: bool = False
    aberrations: tuple[int, ...] = tuple(range(8))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the sensor parameters, in the order of `sensor_otf`'s."""
        names = ["side"]
        names += ["notch"] if self.aperture is not Aperture.SQUARE else []
        names += ["separation"] if self.low_pass is not LowPass.NONE else []
        return tuple(names + (["diffusion"] if self.diffusion else []))


START = {"side": 0.9, "notch": 0.5, "separation": 0.7, "diffusion": 0.25}
BOUNDS = {"side": (0.3, 1.15), "notch": (0.05, 0.9), "separation": (0.05, 1.6), "diffusion": (0.0, 1.5)}
"""Bounds of the parameters: side of the square aperture, side of the missing corner relative to it, distance of the
spots, standard deviation of the charge diffusion."""


def sensor_otf(parts: ModelParts, values: Array, fx: Array, fy: Array) -> Complex:
    """Product of the sensor's transfer functions at frequencies that broadcast, for values in the order of `names`."""
    given = dict(zip(parts.names, values, strict=True))
    otf = aperture_otf(parts.aperture, given["side"], given.get("notch", 0.0), fx, fy)
    d = given.get("separation", 0.0)
    if parts.low_pass in (LowPass.TWO_ALONG_X, LowPass.FOUR):
        otf = otf * np.cos(np.pi * d * fx)
    if parts.low_pass in (LowPass.TWO_ALONG_Y, LowPass.FOUR):
        otf = otf * np.cos(np.pi * d * fy)
    charge = np.exp(-2 * np.pi**2 * given.get("diffusion", 0.0) ** 2 * (fx * fx + fy * fy))
    return np.asarray(otf * charge, dtype=np.complex128)


def aperture_otf(aperture: Aperture, side: float, notch: float, fx: Array, fy: Array) -> Complex:
    """Transfer function of a square without a corner of `notch` times its side. Moduli: Yadid-Pecht, IEEE Trans.
    Electron Devices 47, 2000."""
    whole = side**2 * np.sinc(fx * side) * np.sinc(fy * side) + 0j
    direction = aperture.missing_corner_deg
    if direction is None:
        return np.asarray(whole / side**2)
    n = notch * side
    x, y = (float(np.sign(f(np.radians(direction)))) * (side - n) / 2 for f in (np.cos, np.sin))
    corner = n**2 * np.sinc(fx * n) * np.sinc(fy * n) * np.exp(-2j * np.pi * (fx * x + fy * y))
    return np.asarray((whole - corner) / (side**2 - n**2))
