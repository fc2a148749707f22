from dataclasses import replace

import numpy as np
import pytest

from procedures import BadInput, FilterParameters, filter_film
from procedures.ray_histogram.film import Film, film_of_samples
from procedures.ray_histogram.film_noise import mean_variance
from procedures.ray_histogram.uncertainty import coverage, standard_uncertainty
from simulators.rays.path_tracer import cast
from simulators.rays.ray_scenes import room


def test_variance_of_the_mean_is_that_of_all_samples(rng):
    samples = rng.gamma(0.5, 1.0, (3, 4, 50, 3))
    np.testing.assert_allclose(mean_variance(film_of_samples(samples)), samples.var(2, ddof=1) / 50, rtol=1e-12)


def test_variance_is_estimated_from_histograms_of_a_film_without_it(light):
    film = film_of_samples(light(np.linspace(0.05, 1.0, 30)[None].repeat(30, 0), 256))
    read_off = mean_variance(replace(film, moment2=None))
    ratio = read_off.mean((0, 2)) / mean_variance(film).mean((0, 2))
    # triangular votes add the share of a bin's width squared: some per cent of these wide distributions
    assert (ratio > 1.0).all()
    assert (ratio < 1.25).all()


def test_light_beyond_the_bins_is_accounted_for(rng):
    # one sample in ten is a spike of 1000: variance 1000^2 x 0.1 x 0.9
    samples = np.where(rng.random((20, 20, 100, 1)) < 0.1, 1000.0, 0.0).repeat(3, -1)
    film = film_of_samples(samples)
    np.testing.assert_allclose(mean_variance(replace(film, moment2=None)), mean_variance(film), rtol=1e-3, atol=1e-9)


@pytest.mark.parametrize("scales", [1, 3])
def test_on_a_flat_wall_the_uncertainty_matches_the_error(light, scales):
    film = film_of_samples(light(np.full((32, 32), 0.4), 32))
    parameters = FilterParameters(scales=scales)
    filtered = filter_film(film, parameters)
    sigma = standard_uncertainty(film, filtered.picture, parameters)
    assert sigma.shape == (32, 32, 3)
    # a flat wall's error has few independent parts, some 6 per colour at 13 x 13: its mean square is known to a third
    rms = np.sqrt(np.mean((filtered.picture - 0.4) ** 2))
    assert 0.5 < rms / np.sqrt(np.mean(sigma**2)) < 1.5
    # and the filter removes most of the noise
    assert np.median(sigma) < 0.3 * np.sqrt(np.median(mean_variance(film)))


def test_detail_that_the_filter_may_remove_raises_the_uncertainty(light):
    x = np.arange(32)
    levels = np.where(x < 16, 0.4, 0.4 + 0.12 * np.sin(x * 1.3))[None].repeat(32, 0)
    film = film_of_samples(light(levels, 64))
    sigma = standard_uncertainty(film, filter_film(film).picture)
    assert np.median(sigma[:, 18:30]) > 1.3 * np.median(sigma[:, 2:14])


@pytest.mark.slow
@pytest.mark.parametrize("samples", [pytest.param(64, marks=pytest.mark.nightly), 256])
def test_nineteen_of_twenty_values_are_within_two_sigma(cornell, reference, samples):
    film = cornell[samples].checked()
    filtered = filter_film(film, threads=2)
    sigma = standard_uncertainty(film, filtered.picture, threads=2)
    assert 0.90 <= coverage(filtered.picture, sigma, reference) <= 0.98


@pytest.mark.nightly
def test_uncertainty_covers_the_error_of_a_rendered_room():
    scene, camera = room(24, 32)
    film, reference = Film.blank(24, 32), Film.blank(24, 32)
    cast(scene, camera, 24, film.add, seed=1)
    cast(scene, camera, 192, reference.add, seed=2)
    filtered = filter_film(film, FilterParameters(scales=2))
    sigma = standard_uncertainty(film, filtered.picture, FilterParameters(scales=2))
    combined = np.sqrt(sigma**2 + mean_variance(reference))  # the converged render errs too, independently
    # 95 %, and of 2304 values that are filtered together a few dozen are independent
    assert 0.88 <= coverage(filtered.picture, combined.astype(np.float32), reference.mean) <= 0.99


def test_a_single_sample_gives_no_uncertainty(light):
    film = film_of_samples(light(np.full((24, 24), 0.4), 1))
    with pytest.raises(BadInput, match="576 pixels have a single sample"):
        standard_uncertainty(film, film.mean.astype(np.float32))


@pytest.mark.slow
def test_uncertainty_covers_detail_weaker_than_the_noise(rng):
    """Tiles that the filter mostly removes: without the excess, half of the values lay within two uncertainties."""
    y, x = np.mgrid[:64, :64]
    truth = np.repeat((0.4 + 0.2 * np.sin(x / 9) + 0.2 * ((x // 16 + y // 16) % 2))[..., None], 3, axis=2)
    film = film_of_samples(truth[:, :, None] * rng.gamma(0.5, 2.0, (64, 64, 32, 1)))
    filtered = filter_film(film)
    sigma = standard_uncertainty(film, filtered.picture)
    assert 0.88 <= coverage(filtered.picture, sigma, truth) <= 0.99
