"""An isotropic lens over square photosites: the anisotropy of the camera's maps is theirs."""

from dataclasses import dataclass

import numpy as np
import pytest

from procedures import BadParameter, Psf, PsfField
from procedures.field.maps import FieldMap, derive, mtf50_about, over_height
from procedures.field.photosite import ASSUMED, Photosite, WithoutPhotosite

S, K = 4, 25
SHAPE = (40, 60)
SIGMA = 0.25
"""Standard deviation of the lens's Gaussian in pixels: it fits the support, and its MTF the band."""
LENS_MTF50 = float(np.sqrt(np.log(2) / 2) / np.pi / SIGMA)
FILL = 0.9025
F = np.array([0.1, 0.3, 0.5, 0.7])


def lens_mtf(f: np.ndarray, sigma: float = SIGMA) -> np.ndarray:
    return np.exp(-2 * (np.pi * sigma * f) ** 2)


def camera_psf(fill: float = FILL, pitch: int = 1, noise: float = 0.0, sigma: float = SIGMA) -> Psf:
    """The PSF of lens and photosite: the Fourier integral of both transfer functions over the band."""
    f = (np.arange(256) + 0.5) / 256 * S - S / 2
    along = lens_mtf(f, sigma) * np.sinc(np.sqrt(fill) * f / pitch)
    profile = np.real(np.exp(2j * np.pi * np.outer((np.arange(K) - K // 2) / S, f)) @ along)
    h = np.outer(profile, profile)
    return Psf(h / h.sum(), S, noise**2 * np.eye(K * K))


@dataclass
class Everywhere:
    """One PSF over the whole frame, with the part of a field's API that maps use."""

    psf: Psf
    shape = SHAPE
    s, k = S, K

    def inside(self, points):
        return np.ones(len(points), dtype=bool)

    def parameters(self, points):
        return np.tile(self.psf.parameters, (len(points), 1))

    def at(self, x, y):
        return self.psf

    def covariances(self, x, y):
        return self.psf.parameter_covariance, np.zeros_like(self.psf.parameter_covariance)

    def norm_of_error(self, covariance):
        return float(np.sqrt(np.trace(covariance)))


def everywhere(psf: Psf) -> PsfField:
    return Everywhere(psf)  # type: ignore[return-value]


@pytest.fixture(scope="module")
def maps() -> dict[str, FieldMap]:
    field = everywhere(camera_psf(noise=2e-5))
    return {one.name: one for one in derive(field, 7, WithoutPhotosite(Photosite(FILL)))}


def test_a_map_without_the_photosite_has_no_cross(maps):
    camera, lens = maps["mtf50_sagittal"], maps["mtf50_sagittal_without_photosite"]
    difference = maps["astigmatism_without_photosite"]
    assert np.ptp(camera.value) > 10 * camera.uncertainty.max()
    assert np.ptp(lens.value) < 2 * lens.uncertainty.min()
    assert np.all(np.abs(difference.value) < 2 * difference.uncertainty)


@pytest.mark.parametrize("name", ["mtf50_sagittal_without_photosite", "mtf50_meridional_without_photosite"])
def test_mtf50_without_the_photosite_is_that_of_the_lens(maps, name):
    assert np.all(np.abs(maps[name].value - LENS_MTF50) < 2 * maps[name].uncertainty)


@pytest.mark.parametrize("pitch", [1, 2])
@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 4])
def test_the_quotient_is_the_mtf_of_the_lens(angle, pitch):
    # 1e-4 of the energy lies beyond band and support
    quotient, _ = WithoutPhotosite(Photosite(FILL), pitch).curve(camera_psf(FILL, pitch), F, angle)
    np.testing.assert_allclose(quotient, lens_mtf(F), atol=1e-3)


def test_numbers_without_the_photosite_have_the_uncertainty_of_its_fill_factor():
    # compared with the change when the fill factor is off by its uncertainty
    psf = camera_psf()
    sure, unsure, other = (
        mtf50_about(psf, 0.3, WithoutPhotosite(one))
        for one in (Photosite(FILL), Photosite(FILL, 0.01), Photosite(FILL + 0.01))
    )
    added = np.sqrt(unsure[1][:2] ** 2 - sure[1][:2] ** 2)
    np.testing.assert_allclose(added, np.abs(other[0] - sure[0])[:2], rtol=0.05)
    # the lens's MTF50, at 1.9 cycles per pixel, lies beyond the photosite's first zero
    values, uncertainties = mtf50_about(camera_psf(1.0, sigma=0.1), 0.0, WithoutPhotosite(Photosite(1.0)))
    assert np.isnan(values).all()
    assert np.isnan(uncertainties).all()
    field, frequency = everywhere(camera_psf()), 0.25
    (camera,), (lens,) = over_height(field, (frequency,)), over_height(field, (frequency,), WithoutPhotosite(ASSUMED))
    # all eight directions have the same angle to rows, columns and diagonals
    (own,), _ = ASSUMED.mtf(np.array([frequency]), np.pi / 8, 1)
    np.testing.assert_allclose(lens.sagittal[1:], camera.sagittal[1:] / own, rtol=1e-12)
    assert np.all(lens.sagittal_uncertainty[1:] > camera.sagittal_uncertainty[1:] / own)


@pytest.mark.parametrize(("fill", "uncertainty"), [(0.0, 0.0), (1.2, 0.0), (0.5, 0.5), (float("nan"), 0.0)])
def test_impossible_fill_factors_are_refused(fill, uncertainty):
    with pytest.raises(BadParameter, match="a fill factor must be greater than 0"):
        Photosite(fill, uncertainty)
