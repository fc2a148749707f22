import numpy as np

from procedures.ray_histogram.film import film_of_samples
from procedures.ray_histogram.regression import regress


def test_light_linear_in_position_and_features_is_kept(rng):
    row, column = np.mgrid[:40, :33]
    feature = rng.random((40, 33, 2))
    truth = 0.3 + 0.004 * row - 0.003 * column + feature @ [0.2, 0.1]
    spread = 1.0 + 0.5 * np.resize([-1, 1], 32)  # mean 1
    film = film_of_samples(truth[..., None, None] * spread[:, None] * np.ones(3))
    np.testing.assert_allclose(regress(film, feature)[..., 0], truth, atol=5e-4)  # the ridge's bias


def test_a_feature_keeps_an_edge_while_noise_is_averaged(light):
    edge = (np.arange(40) < 20)[None, :] * np.ones((40, 1))
    truth = 0.3 + 0.1 * edge
    film = film_of_samples(light(truth, 64))
    plain, guided = (regress(film, edge[..., None] * scale) for scale in (0.0, 1.0))
    errors = [np.mean((picture[..., 0] - truth) ** 2) for picture in (film.mean, plain, guided)]
    assert errors[2] < 0.6 * errors[1] < 0.2 * errors[0]
    np.testing.assert_array_equal(guided, regress(film, edge[..., None], threads=2))
