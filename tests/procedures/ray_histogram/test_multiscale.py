from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from procedures.outcome import BadInput
from procedures.ray_histogram.comparison import psnr_db
from procedures.ray_histogram.film import film_of_samples
from procedures.ray_histogram.filter import PAPER, FilterParameters
from procedures.ray_histogram.multiscale import (
    allowed_variance,
    bicubic_upsample,
    downsample,
    filter_film,
    gaussian_downsample,
    recombine,
    samples_of,
    within_range,
)

# PSNR in dB, (samples, kappa, scales) -> (clipped to [0, 1], unclipped): the published program on the same data
PUBLISHED = {
    (256, 1.0, 1): (45.37, 39.59),
    (256, 1.0, 2): (45.55, 41.60),
    (256, 1.0, 3): (46.35, 42.18),
    (256, 0.8, 2): (45.78, 42.19),
    (256, 0.8, 3): (46.15, 42.57),
    (64, 1.0, 2): (41.36, 37.49),
    (64, 1.0, 3): (42.39, 38.37),
    (64, 0.8, 2): (41.97, 38.19),
    (64, 0.8, 3): (42.79, 38.96),
}


QUICK = {(256, 1.0, 1), (256, 0.8, 2), (64, 0.8, 3)}
"""Every number of samples, kappa and scales."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("samples", "kappa", "scales"),
    [one if one in QUICK else pytest.param(*one, marks=pytest.mark.nightly) for one in PUBLISHED],
)
def test_cornell_box_is_cleaner_than_with_the_published_program(cornell, reference, samples, kappa, scales):
    filtered = filter_film(cornell[samples], FilterParameters(kappa=kappa, scales=scales), threads=2)
    clipped, unclipped = psnr_db(filtered.picture, reference)
    assert clipped >= PUBLISHED[samples, kappa, scales][0]
    assert unclipped >= PUBLISHED[samples, kappa, scales][1]


@pytest.mark.slow
@pytest.mark.parametrize("samples", [pytest.param(64, marks=pytest.mark.nightly), 256])
def test_defaults_gain_half_a_decibel_over_the_published_program(cornell, reference, samples):
    clipped, unclipped = psnr_db(filter_film(cornell[samples], threads=2).picture, reference)
    assert clipped >= PUBLISHED[samples, 1.0, 3][0] + 0.5
    assert unclipped >= PUBLISHED[samples, 1.0, 3][1] + 0.5


@pytest.mark.slow
def test_error_falls_with_samples_as_without_false_similarity(light):
    # four flat regions of distinct nature: 3 dB per doubling is the ideal, 2.8 leaves room for the edges
    y, x = np.indices((48, 48))
    truth = np.select([(y < 24) & (x < 24), y < 24, x < 24], [0.1, 0.8, 2.5], 0.3)
    samples = light(truth, 512)
    films = [film_of_samples(samples[:, :, :n]) for n in (64, 512)]
    (few, many), with_means = (
        [psnr_db(filter_film(film, FilterParameters(welch=welch)).picture, truth[..., None])[1] for film in films]
        for welch in (0.0, 3.0)
    )
    assert (many - few) / 3 >= 2.8
    # means separate regions where samples are few; where they are many, histograms do
    assert with_means[0] > few + 0.5
    assert with_means[1] > many - 0.1


@pytest.mark.parametrize("s", [1, 2, 3])
def test_every_scale_has_the_same_number_of_samples(flat_film, s):
    frame = samples_of(flat_film)
    small = downsample(frame, s)
    assert small.count.shape == (-(-24 // 2**s), -(-21 // 2**s))
    np.testing.assert_allclose(small.histogram.sum(dtype=float), frame.histogram.sum(dtype=float), rtol=1e-6)
    np.testing.assert_allclose(small.histogram.sum(-1), 3 * small.count, rtol=1e-5)  # float32


@settings(max_examples=20, deadline=None)
@given(st.integers(2, 40), st.integers(2, 40), st.floats(0.01, 100))
def test_a_constant_survives_both_resamplings(rows, columns, value):
    flat = np.full((rows, columns, 2), value, np.float32)
    small = gaussian_downsample(flat, 1)
    np.testing.assert_allclose(small, value, rtol=1e-5)
    np.testing.assert_allclose(bicubic_upsample(small, (rows, columns)), value, rtol=1e-5)


def test_scales_are_joined_without_loss():
    # Keys' cubic with a = -1/2 reproduces second degree
    y, x = np.indices((9, 8), dtype=np.float32)
    surface = (1 + 0.5 * x - 0.1 * x**2 + 0.2 * x * y + 0.3 * y**2)[..., None]
    large = bicubic_upsample(surface, (17, 15))
    np.testing.assert_allclose(large[::2, ::2], surface, rtol=1e-5)
    y2, x2 = np.indices((17, 15)) / 2
    expected = (1 + 0.5 * x2 - 0.1 * x2**2 + 0.2 * x2 * y2 + 0.3 * y2**2)[..., None]
    np.testing.assert_allclose(large[2:-4, 2:-4], expected[2:-4, 2:-4], rtol=1e-4)
    # a slow error at the fine scale is replaced by the coarse scale's value
    wave = 0.3 * np.cos(2 * np.pi * np.arange(64) / 64)[:, None, None].repeat(64, 1).astype(np.float32)
    amplitude = {
        coarse: np.abs(recombine([wave, np.zeros((32, 32, 1), np.float32)], coarse)).max() for coarse in (0, 1)
    }
    assert amplitude[0] == pytest.approx(0.3)
    assert amplitude[1] < 0.02


@pytest.mark.slow
def test_scales_remove_noise_wider_than_the_block(cornell, reference):
    one, three = (
        psnr_db(filter_film(cornell[64], replace(PAPER, scales=n), threads=2).picture, reference)[0] for n in (1, 3)
    )
    assert three > one + 0.5


def test_a_constant_film_stays_constant_through_as_many_scales_as_fit(flat_film):
    filter_film(flat_film, FilterParameters(scales=2))
    with pytest.raises(BadInput, match=r"4 scales need 6 x 6 pixels.*24 x 21 pixels give 3 x 3"):
        filter_film(flat_film, FilterParameters(scales=4))
    film = replace(flat_film, mean=np.full((24, 21, 3), 0.25))
    np.testing.assert_allclose(filter_film(film).picture, 0.25, rtol=1e-4)  # float32 weights, three scales


def test_a_lamp_causes_no_dark_rim(light):
    # a lamp a thousand times brighter than the wall: exchanged low frequencies alone would undershoot the wall's light
    levels = np.full((48, 48), 0.05)
    levels[20:28, 20:28] = 50.0
    film = film_of_samples(light(levels, 32))
    filtered = filter_film(film).picture
    assert filtered.min() >= film.mean.min()
    np.testing.assert_array_equal(within_range(filtered, film.mean.astype(np.float32)), filtered)


def beside_a_lamp(rng, side, y0, x0, radius, n):
    """A film of a wall and a round lamp 600 times as bright, filtered; its truth, and the lamp's part of pixels."""

    def lit(n):
        y, x = np.mgrid[:side, :side][..., None] + rng.random((2, side, side, n)) - 0.5
        return np.hypot(y - y0, x - x0) < radius

    samples = np.where(lit(n), 30.0, 0.05 * rng.gamma(2.0, 0.5, (side, side, n)))[..., None].repeat(3, -1)
    film, covered = film_of_samples(samples), lit(4096).mean(-1)
    return film, filter_film(film).picture, (30.0 * covered + 0.05 * (1 - covered))[..., None], covered


def relative_error(picture, truth):
    return np.mean((picture - truth) ** 2 / (truth**2 + 0.01))


@pytest.mark.parametrize("n", [16, 64, 256])
def test_a_pixel_beside_a_lamp_keeps_what_its_own_samples_allow(rng, n):
    film, filtered, truth, covered = beside_a_lamp(rng, 48, 24.3, 20.6, 4.2, n)
    # wall pixels whose neighbours a few pixels away see the lamp; a single sample of the lamp would add 30 / n
    beside = (covered == 0) & (gaussian_filter(covered, 2) > 0.02)
    assert np.abs(filtered - film.mean)[beside].max() < min(0.3, 30 / n)
    assert relative_error(filtered, truth) < relative_error(film.mean, truth)


@pytest.mark.nightly
@pytest.mark.parametrize("n", [16, 64, 256])
@pytest.mark.parametrize("seed", range(8))
def test_no_lamp_alone_has_a_larger_relative_error_than_unfiltered(seed, n):
    radius = (4.2, 2.6, 6.8, 5.3)[seed % 4]
    film, filtered, truth, _ = beside_a_lamp(
        np.random.default_rng(seed), 32, 16.3 + 0.1 * seed, 14.6 - 0.13 * seed, radius, n
    )
    assert relative_error(filtered, truth) < relative_error(film.mean, truth)


def test_rare_light_is_shared_by_pixels_that_are_alike(rng):
    # one path in 200 finds light of 40: most of 16-sample pixels have none and a variance far too small
    samples = np.where(rng.random((40, 40, 16, 1)) < 0.005, 40.0, 0.01).repeat(3, -1)
    film = film_of_samples(samples)
    none = film.mean[..., 0] < 0.02
    assert np.median(allowed_variance(film)[none]) == pytest.approx(40**2 * 0.005 / 16, rel=0.5)
    # and their filtered values are nearer to the mean of 0.21 than to the 0.01 of their own samples
    assert np.median(filter_film(film).picture[none]) > 0.11
