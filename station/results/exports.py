"""A plane's PSF for other programs: FITS, float TIFF, its numbers as a table; its radial profile."""

import csv
import io
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.numerics.arrays import Array
from procedures.outcome import Quantity
from procedures.psf import Psf
from procedures.reading.exposure import Exposure
from procedures.transfer_function import radial_profile
from station.common.sanitise import cell
from station.drawing.pictures import described_tiff, float_tiff


def psf_tiff(psf: Psf, plane: str = "", exposure: Exposure | None = None) -> bytes:
    """The support's samples, the photograph's upper row first, as a TIFF of (k, k) float32, sum 1, with metadata."""
    share, uncertainty = psf.energy_outside
    noted = {} if exposure is None else _noted(exposure)
    what = f"support of a PSF of plane {plane}" if plane else "support of a PSF"
    words = [
        f"{what}, {psf.s} samples per pixel, sum 1, first row uppermost",
        f"energy_outside_support = {share:.6g}, standard uncertainty {uncertainty:.2g}",
        *(f"{name} = {value}" for name, value in noted.items()),
    ]
    return described_tiff(float_tiff(psf.h), "; ".join(words))


def psf_fits(psf: Psf, plane: str, version: str | None, exposure: Exposure | None = None) -> bytes:
    """The support's samples as FITS, and their standard uncertainties in a second image, both (k, k) float64.

    Beside the samples, of sum 1, stand EOUTSIDE, the share of all light outside them, and EOUTUNC, its standard
    uncertainty; TAILDENS is A of the mean far tail A / r^3 per square pixel, r in pixels, where all light is 1. The
    first row of the data is the photograph's upper one; the world coordinates are pixels of the plane from the PSF's
    centre, x to the right and y down. What the camera recorded has the keywords of astronomy: DATE-OBS, INSTRUME,
    TELESCOP (the lens), FILTER (the plane), APERTURE (the f-number), FOCALLEN in mm, EXPTIME in s, ISOSPEED.
    Source: FITS standard 4.0, sections 3, 4 and 8.
    """
    sigma = np.sqrt(np.maximum(np.diag(psf.covariance), 0)).reshape(psf.h.shape)
    middle = psf.k // 2 + 1
    grid: Cards = [
        ("CRPIX1", float(middle)), ("CRPIX2", float(middle)), ("CRVAL1", 0.0), ("CRVAL2", 0.0),
        ("CDELT1", 1 / psf.s), ("CDELT2", 1 / psf.s), ("CTYPE1", "X"), ("CTYPE2", "Y"),
        ("CUNIT1", "pixel"), ("CUNIT2", "pixel"), ("BUNIT", "1"), ("ROWORDER", "TOP-DOWN"), ("PLANE", plane),
        ("FILTER", plane), ("SAMPLING", psf.s), ("ORIGIN", "calibration-station"),
        ("CREATOR", f"calibration-station {version or ''}".strip()),
        *([] if exposure is None else _noted(exposure).items()),
    ]  # fmt: skip
    share, uncertainty = psf.energy_outside
    outside: Cards = [
        ("EOUTSIDE", share), ("EOUTUNC", uncertainty), ("TAILDENS", psf.tail_density_px),
        ("COMMENT", "Orientation: the first row is the photograph's upper one; the origin of"),
        ("COMMENT", "X and Y is the PSF's centre, X to the right, Y down, pixels of FILTER."),
        ("COMMENT", "Samples: the support, of sum 1. EOUTSIDE: energy_outside_support,"),
        ("COMMENT", "the share of all light outside it; EOUTUNC: its uncertainty."),
        ("COMMENT", "TAILDENS: A of the far tail A/r^3 per square pixel, all light 1."),
    ]  # fmt: skip
    first = primary_image(psf.h, [("EXTEND", True), ("EXTNAME", "PSF"), *grid, *outside])
    cards = [("EXTNAME", "UNCERTAINTY"), *grid]
    return first + _unit([("XTENSION", "IMAGE"), *_size(sigma), ("PCOUNT", 0), ("GCOUNT", 1), *cards], _bytes(sigma))


def kernel_fits(kernel: Array, photograph: int, version: str | None) -> bytes:
    """The kernel of a photograph's motion as FITS, (K, K) float64, sum 1, the upper row first; coordinates are pixels
    from its middle, right and down."""
    middle = float(len(kernel) // 2 + 1)
    grid: Cards = [
        ("EXTNAME", "KERNEL"), ("CRPIX1", middle), ("CRPIX2", middle), ("CRVAL1", 0.0), ("CRVAL2", 0.0),
        ("CDELT1", 1.0), ("CDELT2", 1.0), ("CTYPE1", "X"), ("CTYPE2", "Y"), ("CUNIT1", "pixel"), ("CUNIT2", "pixel"),
        ("BUNIT", "1"), ("ROWORDER", "TOP-DOWN"), ("PHOTO", photograph), ("SAMPLING", 1),
        ("ORIGIN", "calibration-station"), ("CREATOR", f"calibration-station {version or ''}".strip()),
    ]  # fmt: skip
    return primary_image(kernel, grid)


def _noted(exposure: Exposure) -> dict[str, str | float]:
    keywords = {
        "DATE-OBS": exposure.captured_at, "INSTRUME": exposure.camera, "TELESCOP": exposure.lens,
        "APERTURE": exposure.f_number, "FOCALLEN": exposure.focal_length_mm, "EXPTIME": exposure.exposure_s,
        "ISOSPEED": exposure.iso,
    }  # fmt: skip
    return {name: value for name, value in keywords.items() if value}


def gaussian_radius(mtf50: Quantity, pitch: int) -> Quantity:
    """The PSF's radius for RAW developers: standard deviation, in sensor pixels, of the Gaussian with this MTF50.

    `mtf50` is the radial mean's of the whole PSF, so that the Gaussian blurs as much as lens and sensor, veil included.

    RawTherapee calls it "Radius" of Capture Sharpening, and deconvolves the demosaicked picture with that Gaussian.
    From exp(-2 pi^2 sigma^2 f^2) = 1/2: sigma = sqrt(ln 2 / 2) / (pi f).
    """
    sigma = math.sqrt(math.log(2) / 2) / (math.pi * mtf50.value) * pitch
    method = "sigma of the Gaussian with the same radial MTF50 as the whole PSF"
    return Quantity(sigma, "sensor pixel", sigma * mtf50.uncertainty / mtf50.value, method, mtf50.n)


Numbers = Iterator[tuple[str, str, Quantity]]
"""Plane, name, number."""


def numbers_table(numbers: Numbers) -> bytes:
    """All numbers as CSV: plane, name, value, uncertainty, unit, method, samples."""
    rows = [
        [plane, name, f"{one.value:.9g}", f"{one.uncertainty:.9g}", cell(one.unit), cell(one.method), str(one.n)]
        for plane, name, one in numbers
    ]
    return csv_bytes([["plane", "name", "value", "uncertainty", "unit", "method", "n"], *rows])


def profile_table(psf: Psf, pitch: int) -> bytes:
    """The profile as CSV, radii in pixels of the plane and of the sensor; `pitch` is how many of these are one."""
    profile = radial_profile(psf)
    columns = {"radius [pixel]": profile.radius, "radius_sensor_pixels [sensor pixel]": profile.radius * pitch}
    density = {"density": profile.density, "density_uncertainty": profile.density_uncertainty}
    columns |= {f"{name} [1/pixel^2]": column for name, column in density.items()}
    columns |= {"energy": profile.energy, "energy_uncertainty": profile.energy_uncertainty}
    columns |= {"inside_support": (profile.radius <= profile.support).astype(np.float64)}
    return csv_columns(columns, 9)


def csv_columns(columns: Mapping[str, npt.ArrayLike], digits: int) -> bytes:
    """Columns of numbers, each (n,), as CSV with their names as headings."""
    rows = ([f"{value:.{digits}g}" for value in row] for row in zip(*map(np.asarray, columns.values()), strict=True))
    return csv_bytes([list(columns), *rows])


def csv_bytes(rows: Iterable[Sequence[object]]) -> bytes:
    """Rows as CSV."""
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()


# FITS files, as much of them as PSFs need: images and a table of one row. FITS standard 4.0, sections 3, 4 and 7.

Floats = npt.NDArray[np.floating[Any]]
Cards = list[tuple[str, object]]

BLOCK = 2880
CARD = 80
LONGEST_TEXT = 34
"""Letters of a value: even if all of them are quotes, which are doubled, they fit into a card."""


def primary_image(data: Floats, cards: Cards) -> bytes:
    """An image as the file's first unit; float32 or float64 as the data are."""
    return _unit([("SIMPLE", True), *_size(data), *cards], _bytes(data))


def table_of_one_cube(name: str, cube: npt.NDArray[np.float32], cards: Cards) -> bytes:
    """A file of a binary table with one column and one row, which holds an array of three axes."""
    axes = ",".join(str(n) for n in cube.shape[::-1])
    width = cube.size * 4
    head: Cards = [
        ("XTENSION", "BINTABLE"), ("BITPIX", 8), ("NAXIS", 2), ("NAXIS1", width), ("NAXIS2", 1), ("PCOUNT", 0),
        ("GCOUNT", 1), ("TFIELDS", 1), ("TTYPE1", name), ("TFORM1", f"{cube.size}E"), ("TDIM1", f"({axes})"),
    ]  # fmt: skip
    empty = _unit([("SIMPLE", True), ("BITPIX", 8), ("NAXIS", 0), ("EXTEND", True)], b"")
    return empty + _unit([*head, *cards], _bytes(cube))


def _size(data: Floats) -> Cards:
    axes: Cards = [(f"NAXIS{i}", n) for i, n in enumerate(data.shape[::-1], 1)]
    return [("BITPIX", -8 * data.itemsize), ("NAXIS", data.ndim), *axes]


def _bytes(data: Floats) -> bytes:
    return data.astype(data.dtype.newbyteorder(">")).tobytes()


def _unit(cards: Cards, data: bytes) -> bytes:
    """A header and its data, each filled up to whole blocks."""
    header = "".join(_card(name, value) for name, value in cards) + "END".ljust(CARD)
    return _filled(header.encode("ascii"), b" ") + _filled(data, b"\0")


def _card(name: str, value: object) -> str:
    if name == "COMMENT":
        return f"{name:<8}{value}".ljust(CARD)[:CARD]
    if isinstance(value, bool):
        text = f"{'T' if value else 'F':>20}"
    elif isinstance(value, str):
        text = "'" + _plain(value).replace("'", "''").ljust(8) + "'"
    else:
        text = f"{value!r:>20}".upper()  # the standard knows the exponents E and D, no small e
    return f"{name:<8}= {text}".ljust(CARD)[:CARD]


def _plain(text: str) -> str:
    """Letters that a header takes, as many as have room in a card."""
    return "".join(one if " " <= one <= "~" else "?" for one in text)[:LONGEST_TEXT]


def _filled(data: bytes, filling: bytes) -> bytes:
    return data + filling * (-len(data) % BLOCK)
