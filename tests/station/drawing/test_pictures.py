import cv2
import numpy as np
import pytest

from station.drawing.pictures import display_png, float_tiff


def decoded(data):
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)


@pytest.mark.skipif(int(cv2.__version__.split(".")[0]) < 5, reason="OpenCV 4 reads three floats as XYZ")
def test_a_tiff_keeps_every_value_and_the_order_of_colours(rng):
    picture = rng.normal(0, 10, (5, 4, 3)).astype(np.float32)
    np.testing.assert_array_equal(decoded(float_tiff(picture))[..., ::-1], picture)


def test_a_png_shows_middle_grey_as_srgb_does():
    # 18 % linear is 46.1 % of the scale in sRGB
    shown = decoded(display_png(np.array([[0.18, -1.0, 2.0]])))
    assert shown.tolist() == [[118, 0, 255]]
