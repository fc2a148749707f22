import cv2
import numpy as np
import pytest

from station.drawing.style import smaller


@pytest.mark.parametrize("colours", [2, 256])
def test_picture_of_few_colours_gets_smaller_and_stays_the_same(rng, colours):
    palette = rng.integers(0, 256, (colours, 4), dtype=np.uint8)
    picture = palette[rng.integers(0, colours, (60, 80))]
    png = cv2.imencode(".png", picture)[1].tobytes()
    assert len(smaller(png)) < 0.6 * len(png)
    decoded = cv2.imdecode(np.frombuffer(smaller(png), np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(decoded, picture)


def test_picture_of_many_colours_is_left_alone(rng):
    png = cv2.imencode(".png", rng.integers(0, 256, (40, 40, 4), dtype=np.uint8))[1].tobytes()
    assert smaller(png) == png
    assert smaller(b"no picture") == b"no picture"
