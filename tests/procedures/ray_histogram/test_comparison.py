import numpy as np
import pytest

from procedures.outcome import BadInput
from procedures.ray_histogram.comparison import decibels, psnr_db, shown_error
from procedures.ray_histogram.film import Film, film_of_samples


def test_psnr_is_as_published_and_corrected_for_the_references_noise(cornell, reference, rng, flat_film):
    # the data's README, two decimals: clipped, unclipped
    assert psnr_db(cornell[256].mean, reference) == pytest.approx((32.88, 31.25), abs=0.005)
    assert psnr_db(cornell[64].mean, reference) == pytest.approx((27.02, 25.27), abs=0.005)
    truth = np.full((60, 60, 3), 0.5)
    picture = truth + rng.normal(0, 0.01, truth.shape)
    reference = film_of_samples(truth[:, :, None] + rng.normal(0, 0.1, (60, 60, 100, 3)))  # as noisy as the picture
    expected = ((picture - truth) ** 2).mean()
    # each of 10800 values adds noise of about 2 sigma^2
    assert shown_error(picture, reference) == pytest.approx(expected, abs=4 * 2 * 1e-4 / np.sqrt(10800))
    bare = Film(flat_film.histogram, flat_film.mean, None, flat_film.count, flat_film.dropped)
    with pytest.raises(BadInput, match="the reference has no variance"):
        shown_error(flat_film.mean, bare)
    assert decibels(0.0) == np.inf
    assert decibels(0.01) == pytest.approx(20.0)
