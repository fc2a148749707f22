"""What other programs read: FITS by its standard, TIFF, the radial profile and the numbers."""

from __future__ import annotations

import csv
import io
import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from procedures.outcome import Quantity
from procedures.psf import Psf
from station.exports import gaussian_radius, numbers_table, profile_table, psf_fits, psf_tiff, radial_profile


def gaussian(sigma_px, s=4, k=33, sd=1e-4):
    x = (np.arange(k) - k // 2) / s
    h = np.exp(-(x[:, None] ** 2 + x**2) / (2 * sigma_px**2))
    return Psf(h / h.sum(), s, np.eye(k * k) * sd**2)


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
    psf = gaussian(0.6)
    data = psf_fits(psf, "G1", "0.1.0")
    assert len(data) % 2880 == 0
    (primary, samples), (second, sigma) = units(data)
    assert (primary["SIMPLE"], primary["BITPIX"], primary["PLANE"]) == ("T", "-64", "G1")
    assert (float(primary["CRPIX1"]), float(primary["CDELT1"])) == (17.0, 0.25)
    assert second["XTENSION"] == "IMAGE"
    np.testing.assert_array_equal(samples, psf.h)
    np.testing.assert_allclose(sigma, 1e-4)


def test_fits_is_read_by_astropy():
    fits = pytest.importorskip("astropy.io.fits")
    psf = gaussian(0.6)
    with fits.open(io.BytesIO(psf_fits(psf, "it's", None))) as found:
        found.verify("exception")
        np.testing.assert_array_equal(found[0].data, psf.h)
        assert found[0].header["PLANE"] == "it's"
        assert found["UNCERTAINTY"].data.shape == psf.h.shape


def test_tiff_holds_the_samples_as_float32():
    psf = gaussian(0.6)
    image = cv2.imdecode(np.frombuffer(psf_tiff(psf), np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(image, psf.h.astype(np.float32))


def test_profile_of_a_gaussian_is_the_gaussian():
    # beyond the band of the grid the Gaussian has exp(-2 pi^2 sigma^2 (s/2)^2) < 1e-13, outside its support 1e-6
    sigma = 0.8
    found = radial_profile(gaussian(sigma))
    true = np.exp(-(found.radius**2) / (2 * sigma**2)) / (2 * np.pi * sigma**2)
    np.testing.assert_allclose(found.density, true, atol=1e-5 * true[0])
    # squares that a circle crosses make its edge one sample wide: half a per cent here
    np.testing.assert_allclose(found.energy, 1 - np.exp(-(found.radius**2) / (2 * sigma**2)), atol=0.01)


def test_profile_carries_the_uncertainty_of_independent_samples(rng):
    psf = gaussian(0.8, k=7, sd=1e-3)
    noisy = [Psf(psf.h + 1e-3 * rng.standard_normal(psf.h.shape), 4, psf.covariance) for _ in range(200)]
    found = [radial_profile(one) for one in noisy]
    # a standard deviation from 200 draws has an uncertainty of 5 %; 4 of them
    for name in ("energy", "density"):
        scatter = np.std([getattr(one, name) for one in found], axis=0)
        np.testing.assert_allclose(scatter, getattr(found[0], f"{name}_uncertainty"), rtol=0.2)


def test_profile_tells_radii_of_plane_and_sensor():
    rows = list(csv.DictReader(io.StringIO(profile_table(gaussian(0.6), 2).decode())))
    assert float(rows[3]["radius_sensor_pixels"]) == 2 * float(rows[3]["radius"])
    assert float(rows[-1]["energy"]) == pytest.approx(1, abs=1e-3)
    assert float(rows[0]["energy"]) == 0


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
