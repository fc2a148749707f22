"""A plane's PSF for other programs: FITS, float TIFF, its radial profile, its numbers as a table."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.outcome import Quantity
from procedures.psf import Psf
from station.linear_pictures import float_tiff
from station.names import cell

Array = npt.NDArray[np.float64]

FITS_BLOCK = 2880
FITS_CARD = 80
STEPS_PER_SAMPLE = 2
DIRECTIONS = 32
GAUSSIAN_RADIUS = "gaussian_radius"


def psf_tiff(psf: Psf) -> bytes:
    """The samples as a TIFF, (k, k) float32, sum 1."""
    return float_tiff(psf.h)


# --- FITS --------------------------------------------------------------------------------------------------------


def psf_fits(psf: Psf, plane: str, version: str | None) -> bytes:
    """The samples as FITS, and their standard uncertainties in a second image, both (k, k) float64.

    The first row of the data is the photograph's upper one; the world coordinates are pixels of the plane from the
    PSF's centre, x to the right and y down. Source: FITS standard 4.0, sections 3, 4 and 8.
    """
    sigma = np.sqrt(np.maximum(np.diag(psf.covariance), 0)).reshape(psf.h.shape)
    middle = psf.k // 2 + 1
    grid: list[tuple[str, object]] = [
        ("CRPIX1", float(middle)), ("CRPIX2", float(middle)), ("CRVAL1", 0.0), ("CRVAL2", 0.0),
        ("CDELT1", 1 / psf.s), ("CDELT2", 1 / psf.s), ("CTYPE1", "X"), ("CTYPE2", "Y"),
        ("CUNIT1", "pixel"), ("CUNIT2", "pixel"), ("PLANE", plane), ("SAMPLING", psf.s),
        ("CREATOR", f"calibration-station {version or ''}".strip()),
    ]  # fmt: skip
    size: list[tuple[str, object]] = [("BITPIX", -64), ("NAXIS", 2), ("NAXIS1", psf.k), ("NAXIS2", psf.k)]
    primary = [("SIMPLE", True), *size, ("EXTEND", True), ("EXTNAME", "PSF"), *grid]
    second = [("XTENSION", "IMAGE"), *size, ("PCOUNT", 0), ("GCOUNT", 1), ("EXTNAME", "UNCERTAINTY"), *grid]
    return _unit(primary, psf.h) + _unit(second, sigma)


def _unit(cards: Sequence[tuple[str, object]], data: Array) -> bytes:
    """A header and its data, each filled up to whole blocks."""
    header = "".join(_card(name, value) for name, value in cards) + "END".ljust(FITS_CARD)
    return _filled(header.encode("ascii"), b" ") + _filled(data.astype(">f8").tobytes(), b"\0")


def _card(name: str, value: object) -> str:
    if isinstance(value, bool):
        text = f"{'T' if value else 'F':>20}"
    elif isinstance(value, str):
        text = "'" + value.encode("ascii", "replace").decode().replace("'", "''").ljust(8) + "'"
    else:
        text = f"{value!r:>20}"
    return f"{name:<8}= {text}".ljust(FITS_CARD)[:FITS_CARD]


def _filled(data: bytes, filling: bytes) -> bytes:
    return data + filling * (-len(data) % FITS_BLOCK)


# --- the radial profile ------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Profile:
    """A PSF's mean over directions about its centre, and the energy inside circles, with standard uncertainties.

    Attributes
    ----------
    radius : (n,) float64
        In pixels of the plane, from 0.
    density, density_uncertainty : (n,) float64
        Energy per square pixel on each circle.
    energy, energy_uncertainty : (n,) float64
        Share of the energy inside each circle.
    """

    radius: Array
    density: Array
    density_uncertainty: Array
    energy: Array
    energy_uncertainty: Array


def radial_profile(psf: Psf) -> Profile:
    """The profile out to where circles touch the support's sides.

    The density is that of the band-limited PSF between its samples; a sample's energy enters while the circle crosses
    its square, as in the encircled energy of `procedures.quality`.
    """
    radius = np.arange(STEPS_PER_SAMPLE * (psf.k // 2) + 1) / (STEPS_PER_SAMPLE * psf.s)
    x = psf.offsets_px
    distance = np.hypot(x, x[:, None]).ravel()
    inside = np.clip((radius[:, None] - distance) * psf.s + 0.5, 0, 1) * (radius[:, None] > 0)
    on = np.mean(
        [_interpolation(psf, radius, angle) for angle in np.arange(DIRECTIONS) * 2 * np.pi / DIRECTIONS], axis=0
    )
    h = psf.h.ravel()
    return Profile(radius, on @ h, _sigma(psf, on), inside @ h, _sigma(psf, inside))


def _interpolation(psf: Psf, radius: Array, angle: float) -> Array:
    """Weights (n, k^2) that give the PSF's density at (n,) radii in one direction: sinc interpolation times s^2."""
    along = [np.sinc((radius[:, None] * turn - psf.offsets_px) * psf.s) for turn in (np.sin(angle), np.cos(angle))]
    weights: Array = (along[0][:, :, None] * along[1][:, None, :]).reshape(len(radius), -1)
    return weights * psf.s**2


def _sigma(psf: Psf, weights: Array) -> Array:
    return np.asarray(np.sqrt(np.maximum(np.einsum("ij,ij->i", weights @ psf.covariance, weights), 0)))


def profile_table(psf: Psf, pitch: int) -> bytes:
    """The profile as CSV, radii in pixels of the plane and of the sensor; `pitch` is how many of these are one."""
    found = radial_profile(psf)
    columns = {"radius": found.radius, "radius_sensor_pixels": found.radius * pitch}
    columns |= {"density": found.density, "density_uncertainty": found.density_uncertainty}
    columns |= {"energy": found.energy, "energy_uncertainty": found.energy_uncertainty}
    rows = zip(*columns.values(), strict=True)
    return _csv([list(columns), *([f"{value:.9g}" for value in row] for row in rows)])


def gaussian_radius(mtf50: Quantity, pitch: int) -> Quantity:
    """What RAW developers take for a PSF: the standard deviation, in sensor pixels, of the Gaussian with this MTF50.

    RawTherapee calls it "Radius" of Capture Sharpening, and deconvolves the demosaicked picture with that Gaussian.
    From exp(-2 pi^2 sigma^2 f^2) = 1/2: sigma = sqrt(ln 2 / 2) / (pi f).
    """
    sigma = math.sqrt(math.log(2) / 2) / (math.pi * mtf50.value) * pitch
    method = "sigma of the Gaussian with the same radial MTF50"
    return Quantity(sigma, "sensor pixel", sigma * mtf50.uncertainty / mtf50.value, method, mtf50.n)


# --- the numbers -------------------------------------------------------------------------------------------------

Numbers = Iterator[tuple[str, str, Quantity]]
"""Plane, name, number."""


def numbers_table(numbers: Numbers) -> bytes:
    """All numbers as CSV: plane, name, value, uncertainty, unit, method, samples."""
    rows = [
        [plane, name, f"{one.value:.9g}", f"{one.uncertainty:.9g}", cell(one.unit), cell(one.method), str(one.n)]
        for plane, name, one in numbers
    ]
    return _csv([["plane", "name", "value", "uncertainty", "unit", "method", "n"], *rows])


def _csv(rows: Sequence[Sequence[str]]) -> bytes:
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()
