import numpy as np
import pytest

from procedures.outcome import BadInput
from procedures.ray_histogram.comparison import decibels, psnr_db, shown_error
from procedures.ray_histogram.film import Film, film_of_samples


def test_inputs_have_their_published_psnr(cornell, reference):
    # the data's README, two decimals: clipped, unclipped
    assert psnr_db(cornell[256].mean, reference) == pytest.approx((32.88, 31.25), abs=0.005)
    assert psnr_db(cornell[64].mean, reference) == pytest.approx((27.02, 25.27), abs=0.005)


def test_noise_of_the_reference_is_corrected_for(rng):
    truth = np.full((60, 60, 3), 0.5)
    picture = truth + rng.normal(0, 0.01, truth.shape)
    reference = film_of_samples(truth[:, :, None] + rng.normal(0, 0.1, (60, 60, 100, 3)))  # as noisy as the picture
    expected = ((picture - truth) ** 2).mean()
    # each of 10800 values adds noise of about 2 sigma^2
    assert shown_error(picture, reference) == pytest.approx(expected, abs=4 * 2 * 1e-4 / np.sqrt(10800))


def test_a_reference_without_variance_is_refused(flat_film):
    bare = Film(flat_film.histogram, flat_film.mean, None, flat_film.count, flat_film.dropped)
    with pytest.raises(BadInput, match="the reference has no variance"):
        shown_error(flat_film.mean, bare)


def test_psnr_without_error_is_infinite():
    assert decibels(0.0) == np.inf
    assert decibels(0.01) == pytest.approx(20.0)
