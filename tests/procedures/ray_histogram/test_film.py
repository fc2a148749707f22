import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from procedures.outcome import BadInput
from procedures.ray_histogram.film import BINS, Film, film_of_samples


def test_a_film_has_the_moments_and_one_vote_of_every_sample(rng):
    samples = rng.gamma(0.5, 1.0, (3, 4, 50, 3))
    film = film_of_samples(samples)
    np.testing.assert_allclose(film.mean, samples.mean(2), rtol=1e-13)  # rounding of 50 additions
    np.testing.assert_allclose(film.variance, samples.var(2, ddof=1), rtol=1e-12)
    assert (film.count == 50).all()
    film = film_of_samples(rng.lognormal(0, 2, (2, 2, 200, 3)))
    np.testing.assert_allclose(film.histogram.sum(-1), 200, rtol=1e-5)  # votes are float32
    assert (film.histogram >= 0).all()


@pytest.mark.parametrize(("v", "bin_"), [(0, 0), (1 / 18, 1), (9 / 18, 9), (1, 18), (2, 19), (5, 19)])
def test_a_sample_on_a_node_votes_for_one_bin(v, bin_):
    # the nodes are evenly spaced in (L / 7.5)^(1 / 2.2) up to 1, the last is at 2 and takes the rest
    film = film_of_samples(np.full((1, 1, 1, 3), 7.5 * v**2.2))
    expected = np.eye(BINS)[bin_]
    np.testing.assert_allclose(film.histogram[0, 0], [expected] * 3, atol=1e-5)


def test_histograms_agree_with_the_published_renderers_in_constant_memory(cornell, rng):
    film = film_of_samples(np.full((1, 1, 1, 3), 7.5 * (3.25 / 18) ** 2.2))
    np.testing.assert_allclose(film.histogram[0, 0, 1, 3:5], [0.75, 0.25], atol=1e-5)
    # the mean light from the published histograms is the picture's wherever no sample exceeded the range; triangular
    # votes overestimate a convex function by less than the widest bin's sagitta
    film = cornell[256]
    nodes = 7.5 * (np.arange(18) / 18) ** 2.2
    inside = film.histogram[..., 17:].sum(-1) == 0
    read_off = (film.histogram[..., :18] @ nodes) / film.count[..., None]
    excess = (read_off - film.mean)[inside]
    assert inside.mean() > 0.3
    assert excess.min() > -0.002
    assert excess.max() < 0.02
    film = Film.blank(2, 2)
    before = [id(array) for array in vars(film).values()]
    for _ in range(3):
        film.add([0, 1], [1, 1], rng.random((2, 3)))
    assert [id(array) for array in vars(film).values()] == before


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 30))
def test_merged_films_are_the_film_of_all_samples(seed, first):
    samples = np.random.default_rng(seed).gamma(0.3, 2.0, (2, 3, 30, 3))
    parts = [Film.blank(2, 3), Film.blank(2, 3)]
    for film, part in zip(parts, (samples[:, :, :first], samples[:, :, first:]), strict=True):
        n = part.shape[2]
        film.add(np.repeat([0, 1], 3 * n), np.tile(np.repeat([0, 1, 2], n), 2), part)
    merged, whole = parts[0].merge(parts[1]), film_of_samples(samples)
    np.testing.assert_allclose(merged.mean, whole.mean, rtol=1e-12)
    np.testing.assert_allclose(merged.variance, whole.variance, rtol=1e-11)
    np.testing.assert_allclose(merged.histogram, whole.histogram, atol=1e-4)  # float32 votes, other order
    np.testing.assert_array_equal(merged.count, whole.count)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_samples_that_are_not_finite_are_dropped_and_counted(bad):
    samples = np.ones((1, 2, 4, 3))
    samples[0, 1, 2, 1] = bad
    film = film_of_samples(samples)
    assert film.dropped.tolist() == [[0, 1]]
    assert film.count.tolist() == [[4, 3]]
    np.testing.assert_array_equal(film.mean, 1.0)


def test_samples_and_films_that_do_not_fit_are_refused(rng):
    with pytest.raises(BadInput, match="the film of 2 x 2; got rows 0 to 2, columns 0 to 0"):
        Film.blank(2, 2).add([0, 2], [0, 0], np.ones((2, 3)))
    with pytest.raises(BadInput, match=r"\(2, 2\) and \(2, 3\)"):
        Film.blank(2, 2).merge(Film.blank(2, 3))
    film = Film.blank(2, 2)
    film.add([0, 0, 1], [0, 1, 0], rng.random((3, 3)))
    with pytest.raises(BadInput, match="1 of 4 pixels are empty, the first at row 1, column 1"):
        film.checked()
    samples = rng.random((2, 2, 4, 3))
    samples[1, 0, :, 2] = 1e31
    with pytest.raises(BadInput, match=r"1 of 4 pixels are beyond 1e\+30"):
        film_of_samples(samples).checked()
