"""The profile against PSFs whose own is known, inside the support and in the tail."""

import csv
import io
from dataclasses import replace

import numpy as np
import pytest

from procedures.psf import Psf, PsfTail
from procedures.quality import assess
from procedures.transfer_function import radial_profile
from station.results.exports import profile_table
from tests.psfs import gaussian


def with_tail(psf, amplitudes=(0.04, 0.005, 0.01, 0.0, 0.003, 0.0), sd=2e-3):
    q = len(amplitudes)
    return replace(psf, tail=PsfTail(np.array(amplitudes), sd**2 * np.eye(q), np.zeros((psf.k**2, q))))


def test_profile_of_a_gaussian_is_the_gaussian_with_its_uncertainty(rng):
    # beyond the band of the grid the Gaussian has exp(-2 pi^2 sigma^2 (s/2)^2) < 1e-13, outside its support 1e-6
    sigma = 0.8
    found = radial_profile(gaussian(sigma, k=33))
    true = np.exp(-(found.radius**2) / (2 * sigma**2)) / (2 * np.pi * sigma**2)
    np.testing.assert_allclose(found.density, true, atol=1e-5 * true[0])
    # squares that a circle crosses make its edge a quarter of a sample wide
    np.testing.assert_allclose(found.energy, 1 - np.exp(-(found.radius**2) / (2 * sigma**2)), atol=1e-3)
    psf = gaussian(0.8, k=7, sd=1e-3)
    noisy = [Psf(psf.h + 1e-3 * rng.standard_normal(psf.h.shape), 4, psf.covariance) for _ in range(200)]
    found = [radial_profile(one) for one in noisy]
    # a standard deviation from 200 draws has an uncertainty of 5 %; 4 of them
    for name in ("energy", "density"):
        scatter = np.std([getattr(one, name) for one in found], axis=0)
        np.testing.assert_allclose(scatter, getattr(found[0], f"{name}_uncertainty"), rtol=0.2)
    rows = list(csv.DictReader(io.StringIO(profile_table(gaussian(0.6, k=33), 2).decode())))
    assert float(rows[3]["radius_sensor_pixels [sensor pixel]"]) == 2 * float(rows[3]["radius [pixel]"])
    assert float(rows[-1]["energy"]) == pytest.approx(1, abs=1e-3)
    assert float(rows[0]["energy"]) == 0


def test_beyond_the_support_the_profile_is_the_tails_with_its_uncertainty(rng):
    psf = with_tail(gaussian(0.5, k=17), (0.04,))
    found = radial_profile(psf)
    far = found.radius > 1.5 * found.support * 2**0.5
    assert found.radius[-1] == pytest.approx(16)
    # A / r^3 between samples, less its end within a sample of the last circle
    inner = far & (found.radius < 15)
    np.testing.assert_allclose(found.density[inner], psf.tail_density_px / found.radius[inner] ** 3, rtol=0.01)
    # outside a circle lies 2 pi A / r of all light
    np.testing.assert_allclose(1 - found.energy[far], 2 * np.pi * psf.tail_density_px / found.radius[far], rtol=0.02)
    # with one shape all that is uncertain far out is its amplitude: 2e-3 of 0.04
    relative = found.energy_uncertainty[inner] / (1 - found.energy[inner])
    np.testing.assert_allclose(relative, 2e-3 / 0.04, rtol=0.1)
    psf = with_tail(gaussian(0.6, k=17))
    found, numbers = radial_profile(psf), assess(psf, n=1).numbers
    # between two circles an eighth of a pixel apart the curve is bent by a hundredth of its rise
    assert np.interp(0.8, found.energy, found.radius) == pytest.approx(numbers["encircled_energy_80"].value, rel=0.01)
    psf = with_tail(gaussian(0.8, k=7, sd=1e-3))
    root = np.sqrt(np.diag(psf.parameter_covariance))
    found = []
    for _ in range(200):
        p = psf.parameters + root * rng.standard_normal(len(root))
        found.append(radial_profile(Psf.of(p, psf.parameter_covariance, psf.k, psf.s)))
    for name in ("energy", "density"):
        scatter = np.std([getattr(one, name) for one in found], axis=0)
        np.testing.assert_allclose(scatter, getattr(radial_profile(psf), f"{name}_uncertainty"), rtol=0.2, atol=1e-9)
