import io

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from procedures.reading.tiff_tags import ACTIVE_AREA, BLACK_LEVEL, image_directories, mosaic_tags


def test_tags_of_a_mosaic_and_its_sub_directories_are_read_and_other_files_give_none(shared_data):
    with (shared_data / "raw" / "tinydng_colorchart.dng").open("rb") as file:
        tags = mosaic_tags(file)
    assert tags[BLACK_LEVEL] == (2056,)
    assert tags[ACTIVE_AREA] == (26, 152, 1182, 1886)
    with (shared_data / "raw" / "linear_no_mosaic.dng").open("rb") as file:
        directories = image_directories(file)
    assert (2736,) not in [tags.get(256) for tags in directories]
    assert {tags.get(256) for tags in directories} >= {(256,), (1224,)}
    with (shared_data / "raw" / "RAW_KODAK_DC50.KDC").open("rb") as file:
        assert mosaic_tags(file) == {}


def test_fractions_are_divided(write_dng):
    with write_dng(np.zeros((40, 40), np.uint16), tags={BLACK_LEVEL: ("R", [1.5, 2, 3, 4])}).open("rb") as file:
        assert mosaic_tags(file)[BLACK_LEVEL] == (1.5, 2, 3, 4)


@given(st.sampled_from([b"II*\0", b"MM\0*", b""]), st.binary(max_size=200))
def test_any_bytes_are_survived(magic, rest):
    assert mosaic_tags(io.BytesIO(magic + rest)) == {}
