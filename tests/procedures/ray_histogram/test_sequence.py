import numpy as np
import pytest

from procedures import BadInput, BadParameter, FilterParameters, filter_film
from procedures.ray_histogram.film import Film, film_of_samples
from procedures.ray_histogram.sequence import filter_sequence

SMALL = FilterParameters(scales=1, search=2)


@pytest.fixture
def films(light):
    """Five frames of a wall with increasing light."""
    return [film_of_samples(light(np.full((12, 11), 0.3 + 0.02 * i), 16)) for i in range(5)]


@pytest.mark.parametrize("reach", [0, 1, 2, 7])
def test_every_frame_is_filtered_with_its_neighbours(films, reach):
    results = list(filter_sequence(films, SMALL, reach=reach))
    assert len(results) == len(films)
    for i, frame in enumerate(results):
        neighbours = [film for j, film in enumerate(films) if 0 < abs(j - i) <= reach]
        expected = filter_film(films[i], SMALL, neighbours=neighbours)
        np.testing.assert_array_equal(frame.picture, expected.picture)
        assert frame.uncertainty is None


def test_no_more_films_are_read_than_a_frame_needs(films):
    loaded = []

    def read():
        for film in films:
            loaded.append(film)
            yield film

    sequence = filter_sequence(read(), SMALL, reach=1)
    next(sequence)
    assert len(loaded) == 2  # the frame and the one after it


def test_neighbours_reduce_the_uncertainty(light):
    films = [film_of_samples(light(np.full((16, 16), 0.4), 16)) for _ in range(3)]
    alone, together = (list(filter_sequence(films, SMALL, reach=n, uncertain=True))[1] for n in (0, 1))
    ratio = np.mean(alone.uncertainty**2) / np.mean(together.uncertainty**2)
    # three frames of equal light: about a third of the variance
    assert 2 < ratio < 4


def test_frames_of_another_size_and_a_negative_reach_are_refused(films):
    wrong = Film.blank(4, 4)
    wrong.add(*np.repeat(np.indices((4, 4)).reshape(2, -1), 2, axis=1), np.ones((32, 3)))
    with pytest.raises(BadInput, match="frames of different sizes"):
        list(filter_sequence([*films[:2], wrong], SMALL))
    with pytest.raises(BadParameter, match="0 frames or more; got -1"):
        list(filter_sequence(films, SMALL, reach=-1))
