"""A lens that is alike in all directions, over square photosites: what is not round in the camera's maps is theirs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from procedures.field.image_height import over_height
from procedures.field.maps import BEFORE_PHOTOSITES, FieldMap, derive, mtf50_about
from procedures.field.photosite import ASSUMED, Photosite, WithoutPhotosite
from procedures.outcome import BadParameter
from procedures.psf import Psf
from procedures.psf_field import PsfField

S, K = 4, 25
SHAPE = (40, 60)
SIGMA = 0.25
"""Of the lens's Gaussian, in pixels of the plane: its light lies within the support, and its MTF within the band."""
LENS_MTF50 = float(np.sqrt(np.log(2) / 2) / np.pi / SIGMA)
FILL = 0.9025
F = np.array([0.1, 0.3, 0.5, 0.7])


def lens_mtf(f: np.ndarray, sigma: float = SIGMA) -> np.ndarray:
    return np.exp(-2 * (np.pi * sigma * f) ** 2)


def seen(fill: float = FILL, pitch: int = 1, noise: float = 0.0, sigma: float = SIGMA) -> Psf:
    """The PSF of lens and photosite: the Fourier integral of both transfer functions over the band."""
    f = (np.arange(256) + 0.5) / 256 * S - S / 2
    along = lens_mtf(f, sigma) * np.sinc(np.sqrt(fill) * f / pitch)
    profile = np.real(np.exp(2j * np.pi * np.outer((np.arange(K) - K // 2) / S, f)) @ along)
    h = np.outer(profile, profile)
    return Psf(h / h.sum(), S, noise**2 * np.eye(K * K))


@dataclass
class Everywhere:
    """One PSF over the whole frame; all that a map asks of a field."""

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
    field = everywhere(seen(noise=2e-5))
    return {one.name: one for one in derive(field, 7, WithoutPhotosite(Photosite(FILL)))}


def test_a_map_without_the_photosite_has_no_cross(maps):
    camera, lens = maps["mtf50_sagittal"], maps["mtf50_sagittal_without_photosite"]
    difference = maps["astigmatism_without_photosite"]
    assert np.ptp(camera.value) > 10 * camera.uncertainty.max()
    assert np.ptp(lens.value) < 2 * lens.uncertainty.min()
    assert np.all(np.abs(difference.value) < 2 * difference.uncertainty)


@pytest.mark.parametrize("name", ["mtf50_sagittal_without_photosite", "mtf50_meridional_without_photosite"])
def test_it_is_that_of_the_lens(maps, name):
    assert np.all(np.abs(maps[name].value - LENS_MTF50) < 2 * maps[name].uncertainty)


@pytest.mark.parametrize("pitch", [1, 2])
@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 4])
def test_the_camera_over_the_photosite_is_the_lens(angle, pitch):
    # what lies beyond band and support is 1e-4 of the light
    found, _ = WithoutPhotosite(Photosite(FILL), pitch).curve(seen(FILL, pitch), F, angle)
    np.testing.assert_allclose(found, lens_mtf(F), atol=1e-3)


def test_the_fill_factors_error_is_in_the_bar():
    # by the change itself: the fill factor off by its uncertainty, everything else as it was
    psf = seen()
    sure, unsure, other = (
        mtf50_about(psf, 0.3, WithoutPhotosite(one))
        for one in (Photosite(FILL), Photosite(FILL, 0.01), Photosite(FILL + 0.01))
    )
    added = np.sqrt(unsure[1][:2] ** 2 - sure[1][:2] ** 2)
    np.testing.assert_allclose(added, np.abs(other[0] - sure[0])[:2], rtol=0.05)


def test_where_hardly_anything_passes_there_is_no_number():
    # the lens's MTF50, at 1.9 cycles per pixel, lies beyond the photosite's first zero
    values, uncertainties = mtf50_about(seen(1.0, sigma=0.1), 0.0, WithoutPhotosite(Photosite(1.0)))
    assert np.isnan(values).all()
    assert np.isnan(uncertainties).all()


def test_over_image_height_it_is_divided_by_the_same():
    field, frequency = everywhere(seen()), 0.25
    (camera,), (lens,) = over_height(field, (frequency,)), over_height(field, (frequency,), WithoutPhotosite(ASSUMED))
    # all eight directions from the centre are as far from rows, columns and diagonals
    (own,), _ = ASSUMED.mtf(np.array([frequency]), np.pi / 8, 1)
    np.testing.assert_allclose(lens.sagittal[1:], camera.sagittal[1:] / own, rtol=1e-12)
    assert np.all(lens.sagittal_uncertainty[1:] > camera.sagittal_uncertainty[1:] / own)


@pytest.mark.parametrize(("fill", "uncertainty"), [(0.0, 0.0), (1.2, 0.0), (0.5, 0.5), (float("nan"), 0.0)])
def test_a_fill_factor_is_a_part(fill, uncertainty):
    with pytest.raises(BadParameter, match="fills a part of its pixel"):
        Photosite(fill, uncertainty)


def test_names_say_that_they_are_not_the_cameras():
    assert all(one.endswith("_without_photosite") and "without" in one.label for one in BEFORE_PHOTOSITES)
