from dataclasses import replace

import numpy as np
import pytest

from procedures import FilterParameters, filter_film
from procedures.ray_histogram.film import film_of_samples
from procedures.ray_histogram.rims import lamp_rims
from procedures.ray_histogram.uncertainty import standard_uncertainty

RADIANCE, WALL = 30.0, 0.05


@pytest.fixture
def lamps(rng):
    """Film of 16 samples of round lamps before a wall, and the mean of infinitely many."""

    def seen(n):
        y, x = np.indices((48, 48))[..., None] + rng.random((2, 48, 48, n))
        return sum((y - r) ** 2 + (x - c) ** 2 < radius**2 for r, c, radius in ((12.3, 13.1, 5.4), (33.7, 30.2, 2.1)))

    wall = WALL * rng.gamma(2.0, 0.5, (48, 48, 16))
    samples = np.where(seen(16), RADIANCE, wall)[..., None].repeat(3, -1)
    covered = seen(1024).mean(-1)[..., None]
    return film_of_samples(samples), RADIANCE * covered + WALL * (1 - covered)


def test_a_rim_lowers_the_error_and_nothing_else_is_changed(lamps, rng, flat_film):
    film, truth = lamps
    own, shaped = (filter_film(film, replace(FilterParameters(), rims=rims)).picture for rims in (False, True))
    rim = (truth[..., 0] > 0.1) & (truth[..., 0] < 29)
    errors = [np.mean((np.clip(picture, 0, 1) - np.clip(truth, 0, 1))[rim] ** 2) for picture in (own, shaped)]
    assert errors[1] < 0.75 * errors[0]  # 0.26 to 0.62 with four seeds
    sigma = standard_uncertainty(film, shaped)
    assert np.mean(np.abs(shaped - truth)[rim] <= 2 * sigma[rim]) > 0.85
    np.testing.assert_array_equal(own[44:], shaped[44:])
    y, x = np.indices((24, 24)) - 11.7
    samples = np.where((y**2 + x**2 < 16)[..., None], RADIANCE, WALL * rng.gamma(2.0, 0.5, (24, 24, 16)))
    samples[12, 17, 0] = RADIANCE
    film = film_of_samples(samples[..., None].repeat(3, -1))
    values, _ = lamp_rims(film, film.mean + 1.0)
    np.testing.assert_array_equal(values[12, 17], film.mean[12, 17])
    film, _ = lamps
    # another number of samples, but no histograms; an even wall; a lamp of a shape that no rim has: single pixels
    bare = replace(film, histogram=film.histogram[..., :0])
    speckles = np.where(rng.random((32, 32, 1, 1)) < 0.5, RADIANCE, WALL).repeat(16, 2).repeat(3, 3)
    for other in (bare, flat_film, film_of_samples(speckles)):
        assert np.isnan(lamp_rims(other, other.mean)).all()
