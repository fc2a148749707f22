"""What other programs read: FITS by its standard, TIFF, the radial profile and the numbers."""

import csv
import io
import math
import re
from dataclasses import replace

import cv2
import exifread
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from procedures.outcome import Quantity
from procedures.psf import PsfTail
from procedures.reading.exposure import Exposure
from station.results.exports import (
    gaussian_radius,
    kernel_fits,
    numbers_table,
    primary_image,
    psf_fits,
    psf_tiff,
    table_of_one_cube,
)
from tests.psfs import gaussian


def units(data):
    """Header and image of each unit of a FITS file, read by the standard's fixed format."""
    while data:
        cards = []
        while not cards or cards[-1] != "END":
            cards.append(data[:80].decode("ascii").rstrip())
            data = data[80:]
        data = data[-len(cards) % 36 * 80 :]
        values = {card[:8].rstrip(): card[10:].strip().strip("'").rstrip() for card in cards[:-1]}
        shape = int(values["NAXIS2"]), int(values["NAXIS1"])
        size = 8 * shape[0] * shape[1]
        yield values, np.frombuffer(data[:size], ">f8").reshape(shape)
        data = data[size + -size % 2880 :]


def test_fits_holds_samples_and_uncertainties():
    psf = gaussian(0.6, k=33)
    data = psf_fits(psf, "G1", "0.1.0")
    assert len(data) % 2880 == 0
    (primary, samples), (second, sigma) = units(data)
    # the middle of 33 samples, four to a pixel
    grid = {"NAXIS": "2", "NAXIS1": "33", "NAXIS2": "33", "BITPIX": "-64", "CRPIX1": "17.0", "CRPIX2": "17.0",
            "CRVAL1": "0.0", "CRVAL2": "0.0", "CDELT1": "0.25", "CDELT2": "0.25", "CTYPE1": "X", "CTYPE2": "Y",
            "CUNIT1": "pixel", "CUNIT2": "pixel", "BUNIT": "1", "ROWORDER": "TOP-DOWN", "PLANE": "G1", "FILTER": "G1",
            "SAMPLING": "4", "ORIGIN": "calibration-station", "CREATOR": "calibration-station 0.1.0"}  # fmt: skip
    whole = {"SIMPLE": "T", "EXTEND": "T", "EXTNAME": "PSF", **grid}
    outside = {"EOUTSIDE", "EOUTUNC", "TAILDENS", "COMMENT"}
    assert {name: value for name, value in primary.items() if name not in outside} == whole
    assert second == {"XTENSION": "IMAGE", "PCOUNT": "0", "GCOUNT": "1", "EXTNAME": "UNCERTAINTY", **grid}
    np.testing.assert_array_equal(samples, psf.h)
    np.testing.assert_allclose(sigma, 1e-4)


def test_fits_and_tiff_show_what_the_camera_noted():
    noted = Exposure(
        camera="Nikon 'D750' \u00e9" + "x" * 60, lens="50 mm", exposure_s=0.02, f_number=5.6, iso=100.0,
        focal_length_mm=50.0, captured_at="2026-03-14T10:11:12",
    )  # fmt: skip
    (primary, _), (second, _) = units(psf_fits(gaussian(0.6, k=33), "G1", "0.1.0", noted))
    assert (primary["BUNIT"], primary["ROWORDER"], primary["FILTER"]) == ("1", "TOP-DOWN", "G1")
    assert primary["ORIGIN"] == second["ORIGIN"] == "calibration-station"
    assert primary["DATE-OBS"] == "2026-03-14T10:11:12"
    assert primary["INSTRUME"].startswith("Nikon ''D750'' ?xxx")
    assert [float(primary[name]) for name in ("APERTURE", "EXPTIME", "FOCALLEN", "ISOSPEED")] == [5.6, 0.02, 50, 100]
    (bare, _), _ = units(psf_fits(gaussian(0.6, k=33), "G1", "0.1.0"))
    assert not {"DATE-OBS", "INSTRUME", "APERTURE"} & bare.keys()
    tags = exifread.process_file(io.BytesIO(psf_tiff(gaussian(0.6, k=33), "G1", Exposure(camera="Nikon D750"))))
    stated = str(tags["Image ImageDescription"])
    assert stated.startswith("support of a PSF of plane G1, 4 samples per pixel, sum 1, first row uppermost")
    assert "INSTRUME = Nikon D750" in stated


def with_tail(psf):
    """With 0.04 within the reach of the tail, beside 1 inside the support."""
    return replace(psf, tail=PsfTail(np.array([0.04]), np.array([[1e-6]]), np.zeros((psf.k**2, 1))))


def test_outside_the_support_kernels_and_exponents_follow_the_standard():
    psf = with_tail(gaussian(0.6, k=33))
    share, uncertainty = psf.energy_outside
    assert 0.04 / 1.04 < share < 0.06  # 0.04 beside the support's 1, and what goes on beyond the shapes' end
    (primary, samples), (second, _) = units(psf_fits(psf, "G1", "0.1.0"))
    np.testing.assert_array_equal(samples, psf.h)
    assert float(primary["EOUTSIDE"]) == pytest.approx(share)
    assert float(primary["EOUTUNC"]) == pytest.approx(uncertainty)
    assert float(primary["TAILDENS"]) == pytest.approx(psf.tail_density_px)
    assert "EOUTSIDE" not in second
    data = psf_tiff(psf)
    tags = exifread.process_file(io.BytesIO(data))
    assert f"energy_outside_support = {share:.6g}" in str(tags["Image ImageDescription"])
    np.testing.assert_array_equal(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED), np.float32(psf.h))
    kernel = np.arange(25.0).reshape(5, 5)
    ((header, found),) = units(kernel_fits(kernel, 2, None))
    np.testing.assert_array_equal(found, kernel)
    assert header == {
        "SIMPLE": "T", "BITPIX": "-64", "NAXIS": "2", "NAXIS1": "5", "NAXIS2": "5", "EXTNAME": "KERNEL",
        "CRPIX1": "3.0", "CRPIX2": "3.0", "CRVAL1": "0.0", "CRVAL2": "0.0", "CDELT1": "1.0", "CDELT2": "1.0",
        "CTYPE1": "X", "CTYPE2": "Y", "CUNIT1": "pixel", "CUNIT2": "pixel", "BUNIT": "1", "ROWORDER": "TOP-DOWN",
        "PHOTO": "2", "SAMPLING": "1", "ORIGIN": "calibration-station", "CREATOR": "calibration-station",
    }  # fmt: skip
    # FITS 4.0, section 4.2.4: E or D; without a tail the share outside is rounding
    (primary, _), _ = units(psf_fits(gaussian(0.6, k=33), "G1", None))
    assert 0 < float(primary["EOUTSIDE"]) < 1e-9
    assert re.fullmatch(r"\d\.\d+E-\d+", primary["EOUTSIDE"])


@given(st.floats(0.2, 3), st.sampled_from([1, 2]))
def test_gaussian_radius_of_a_gaussian_is_its_own(sigma, pitch):
    f50 = math.sqrt(math.log(2) / 2) / (math.pi * sigma)
    assert math.exp(-2 * math.pi**2 * sigma**2 * f50**2) == pytest.approx(0.5)
    found = gaussian_radius(Quantity(f50, "cycles/pixel", 0.01 * f50, "", 9), pitch)
    assert found.value == pytest.approx(sigma * pitch)
    assert found.uncertainty == pytest.approx(0.01 * found.value)


def test_numbers_are_rows_with_unit_and_method():
    table = numbers_table(iter([("G1", "mtf50", Quantity(0.5, "cycles/pixel", 0.01, "=crossing, first", 12))]))
    (row,) = csv.DictReader(io.StringIO(table.decode()))
    assert row == {
        "plane": "G1", "name": "mtf50", "value": "0.5", "uncertainty": "0.01", "unit": "cycles/pixel",
        "method": "'=crossing, first", "n": "12",
    }  # fmt: skip


def test_the_first_axis_of_fits_runs_along_a_row():
    image = np.arange(6.0).reshape(2, 3)
    ((header, found),) = units(primary_image(image, [("LOW", 1.5e-300)]))
    assert (header["NAXIS1"], header["NAXIS2"], header["BITPIX"]) == ("3", "2", "-64")
    np.testing.assert_array_equal(found, image)
    assert b"QUOTES  = '" + b"''" * 34 + b"'" in primary_image(image, [("QUOTES", "'" * 40)])
    cube = np.arange(24, dtype=np.float32).reshape(2, 3, 4)
    table = table_of_one_cube("PSF", cube, [("EXTNAME", "X")])
    text = table[:5760].decode("ascii")
    cards = [(text[at : at + 8].strip(), text[at + 10 : at + 80].strip()) for at in range(0, 5760, 80)]
    assert [card for card in cards if card[0]] == [
        ("SIMPLE", "T"), ("BITPIX", "8"), ("NAXIS", "0"), ("EXTEND", "T"), ("END", ""),
        ("XTENSION", "'BINTABLE'"), ("BITPIX", "8"), ("NAXIS", "2"), ("NAXIS1", "96"), ("NAXIS2", "1"),
        ("PCOUNT", "0"), ("GCOUNT", "1"), ("TFIELDS", "1"), ("TTYPE1", "'PSF     '"), ("TFORM1", "'24E     '"),
        ("TDIM1", "'(4,3,2) '"), ("EXTNAME", "'X       '"), ("END", ""),
    ]  # fmt: skip
    assert table.endswith(cube.astype(">f4").tobytes() + bytes(2880 - 96))
