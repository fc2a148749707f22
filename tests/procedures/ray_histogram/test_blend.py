import sys

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from procedures.outcome import BadInput
from procedures.ray_histogram.blend import (
    DEMODULATED,
    DENOISED,
    HISTOGRAMS,
    REGRESSED,
    STRICTER,
    UNFILTERED,
    Render,
    blend,
    cross_validated,
    divisor,
    open_image_denoise,
)
from procedures.ray_histogram.film import film_of_samples
from procedures.ray_histogram.render_files import halves_of_pictures, halves_of_samples


def error(picture, truth):
    return np.mean((picture - truth) ** 2)


@pytest.fixture
def textured(rng):
    """Samples of smooth light on a fine texture, the texture's albedo, and the light's mean."""
    albedo = rng.uniform(0.1, 0.9, (32, 32, 3))
    smooth = 0.5 + 0.3 * np.sin(np.arange(32) / 8)[:, None, None]
    truth = albedo * smooth
    return truth[:, :, None] * rng.gamma(1.0, 1.0, (32, 32, 32, 1)), albedo, truth


def test_weights_follow_the_truth_and_the_albedo(rng, textured):
    # left of the middle the first candidate is true and the second has an error as large as the noise, right the other
    truth = np.full((48, 48, 3), 0.4)
    wrong = truth + 0.05
    left = (np.arange(48) < 24)[None, :, None]
    films = [film_of_samples(truth[:, :, None] * rng.gamma(1.0, 1.0, (48, 48, 64, 1))) for _ in range(2)]
    pictures = {"one": np.where(left, truth, wrong), "other": np.where(left, wrong, truth)}
    weights = cross_validated((films[0], films[1]), pictures, pictures)
    np.testing.assert_allclose(sum(weights.values()), 1.0, rtol=1e-12)
    assert weights["other"][:, :16].mean() < 0.15
    assert weights["other"][:, 32:].mean() > 0.85
    samples, albedo, truth = textured
    halves, whole = halves_of_samples({"samples": samples, "albedo": albedo})
    blended, weights = blend(halves, whole)
    assert set(weights) == {HISTOGRAMS, STRICTER, DEMODULATED, REGRESSED, UNFILTERED}
    assert weights[DEMODULATED] > 0.7
    assert error(blended.picture, truth) < 0.2 * error(whole.film.mean, truth)


def test_a_worthless_candidate_does_not_harm(light):
    truth = np.full((32, 32), 0.4)
    render = halves_of_samples({"samples": light(truth, 64)})
    (alone, _), (spoiled, weights) = blend(*render), blend(*render, denoiser=lambda one: np.full((32, 32, 3), 0.9))
    assert weights[DENOISED] < 0.02
    assert error(spoiled.picture, 0.4) < 1.5 * error(alone.picture, 0.4)


def test_blends_use_good_candidates_and_do_not_divide_lamps(rng):
    # noise of a whole grid of tiles, which a histogram filter keeps and the candidate knows
    y, x = np.mgrid[:32, :32]
    truth = np.repeat((0.3 + 0.4 * ((x + y) % 2))[..., None], 3, axis=2)
    samples = truth[:, :, None] * rng.gamma(0.3, 1 / 0.3, (32, 32, 8, 1))
    halves, whole = halves_of_samples({"samples": samples})
    _, weights = blend(halves, whole, denoiser=lambda render: truth)
    assert weights[DENOISED] > 0.4
    # no histograms: the variance follows from the difference of the pictures
    truth = gaussian_filter(rng.random((40, 40, 3)), (6, 6, 0)) + 0.2
    first, second = ({"image": truth + 0.05 * rng.standard_normal(truth.shape)} for _ in range(2))
    halves, whole = halves_of_pictures(first, second)
    assert np.median(whole.film.moment2 / 2) == pytest.approx(0.05**2 / 2, rel=0.1)  # of the mean of both
    blended, _ = blend(halves, whole)
    assert error(blended.picture, truth) < 0.2 * error(whole.film.mean, truth)
    # the error of a smooth picture has some tens of independent parts
    assert 0.8 < (np.abs(blended.picture - truth) <= 2 * blended.uncertainty).mean() < 0.99
    albedo = np.array([[[0.0, 0.0, 0.01], [0.0, 0.5, 7.0]]])
    np.testing.assert_array_equal(divisor(albedo), [[[1, 1, 1], [0.05, 0.5, 1]]])


def test_halves_of_single_samples_are_refused(light):
    film = film_of_samples(light(np.full((24, 24), 0.4), 1))
    with pytest.raises(BadInput, match="each half needs two samples per pixel"):
        blend((Render(film), Render(film)), Render(film.merge(film)))


def test_the_denoiser_that_is_not_installed_is_named(flat_film, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyoidn.denoise", None)
    with pytest.raises(BadInput, match="requires the package pyoidn"):
        open_image_denoise(Render(flat_film))


def test_the_denoiser_takes_albedo_and_normals(light):
    pytest.importorskip("pyoidn", reason="Open Image Denoise is an extra")
    film = film_of_samples(light(np.full((32, 32), 0.4), 16))
    normal = np.broadcast_to([0.0, 0.0, 1.0], (32, 32, 3))
    picture = open_image_denoise(Render(film, albedo=np.full((32, 32, 3), 0.5), normal=normal))
    assert error(picture, 0.4) < 0.1 * error(film.mean, 0.4)
