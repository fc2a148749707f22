import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from procedures import BadParameter, filter_film
from procedures.ray_histogram.adaptive import allot
from procedures.ray_histogram.film import Film, film_of_samples


class Renderer:
    """Casts samples into a film, up to a requested number per pixel."""

    def __init__(self, truth, seed):
        self.truth, self.rng, self.film = truth, np.random.default_rng(seed), Film.blank(*truth.shape)

    def __call__(self, wanted):
        more = np.maximum(wanted - self.film.count.astype(int), 0)
        row, column = (np.repeat(i.ravel(), more.ravel()) for i in np.indices(more.shape))
        light = self.rng.gamma(1.0, 1.0, (row.size, 3)) * self.truth[row, column, None]
        self.film.add(row, column, light)


def test_pixels_with_few_similar_ones_get_more_samples_and_less_error(rng):
    leaves = rng.uniform(0.2, 1.0, (10, 5)).repeat(3, 0).repeat(3, 1)
    truth = np.concatenate([np.full((30, 45), 0.5), leaves], axis=1)
    renderer = Renderer(truth, 1)
    renderer(np.full(truth.shape, 16))
    filtered = filter_film(renderer.film)
    more = allot(renderer.film, filtered.similar, 16 * truth.size)
    assert more[:, 47:].mean() > 1.25 * more[:, :40].mean()
    even = Renderer(truth, 2)
    even(np.full(truth.shape, 48))
    adaptive = Renderer(truth, 3)
    adaptive(np.full(truth.shape, 16))
    for _ in range(2):
        counts = adaptive.film.count.astype(int)
        adaptive(counts + allot(adaptive.film, filter_film(adaptive.film).similar, 16 * truth.size))
    filtered = filter_film(adaptive.film)
    assert adaptive.film.count.sum() == even.film.count.sum()
    errors = [np.mean((f.picture - truth[..., None]) ** 2) for f in (filtered, filter_film(even.film))]
    assert errors[0] < 0.9 * errors[1]


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6), st.integers(0, 2**32 - 1))
def test_the_budget_is_spent_to_the_last_sample(budget, seed):
    rng = np.random.default_rng(seed)
    film = film_of_samples(rng.gamma(0.3, 1.0, (5, 6, 4, 3)))
    more = allot(film, rng.uniform(1, 169, (5, 6)).astype(np.float32), budget)
    assert more.sum() == budget
    assert more.min() >= 0


def test_samples_go_where_they_are_missing_within_possible_budgets(rng, flat_film):
    # one of two equal halves has ten times the samples: the other gets all of a small budget
    film = film_of_samples(np.ones((4, 8, 40, 3)))
    film.count[:, 4:] = 4
    more = allot(film, np.full((4, 8), 9.0, np.float32), 16 * 10)
    np.testing.assert_array_equal(more[:, 4:], 10)
    np.testing.assert_array_equal(more[:, :4], 0)
    with pytest.raises(BadParameter, match="got -1"):
        allot(flat_film, np.ones((24, 21), np.float32), -1)
