import numpy as np
import pytest

from procedures.ray_histogram.film import BINS, Film
from station.demo.reproduce import rays_rival_rows as rivals


@pytest.fixture
def samples(rng, monkeypatch):
    monkeypatch.setattr(rivals, "SIZE", (6, 8))
    pixels = np.repeat(np.arange(rivals.SIZE[0] * rivals.SIZE[1]), 4)
    return pixels, rng.gamma(1.0, 1.5, (pixels.size, 3))  # some beyond the range of the nodes


def test_histograms_have_the_margins_of_a_film(samples):
    pixels, colours = samples
    film = Film.blank(*rivals.SIZE)
    film.add(*np.divmod(pixels, rivals.SIZE[1]), colours)
    votes = rivals.histograms(pixels, colours, BINS, joint=False)
    assert votes == pytest.approx(film.histogram.reshape(votes.shape), abs=1e-5)
    joint = rivals.histograms(*samples, 4, joint=True).reshape(*rivals.SIZE, 4, 4, 4)
    separate = rivals.histograms(*samples, 4, joint=False).reshape(*rivals.SIZE, 3, 4)
    for colour, others in enumerate(((3, 4), (2, 4), (2, 3))):
        assert joint.sum(others) == pytest.approx(separate[..., colour, :], abs=1e-5)


def film_of(rng, mean):
    film = Film.blank(16, 16)
    pixels = np.repeat(np.arange(256), 64)
    film.add(*np.divmod(pixels, 16), rng.gamma(4.0, mean.ravel()[pixels, None] / 4.0, (pixels.size, 3)))
    return film


def test_rival_filters_remove_noise_and_keep_an_edge(rng):
    truth = np.where(np.arange(16) < 8, 0.2, 0.8) * np.ones((16, 1))
    film = film_of(rng, truth)
    error = rivals.nl_means(film) - truth[..., None]
    # about half of 169 neighbours are alike: noise falls several times, and the edge does not spread
    assert error.std() < 0.4 * (film.mean - truth[..., None]).std()
    truth = np.full((16, 16, 3), 0.5)
    film = film_of(rng, truth[..., 0])
    for by_means in (True, False):
        best = rivals.oracle(film, truth, 0, by_means=by_means)
        assert np.abs(best - truth).sum() < 0.5 * np.abs(film.mean - truth).sum()
