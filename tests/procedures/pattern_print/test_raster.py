import struct

import cv2
import numpy as np
import pytest

from procedures.outcome import BadParameter
from procedures.pattern import CELLS
from procedures.pattern_print.formats import Bitmap, bitmap, pgm, png
from procedures.pattern_print.sheet import Size
from procedures.pattern_print.source import Source

PER_CELL = 4


def _decoded(data: bytes) -> Bitmap:
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert image is not None
    return image.astype(np.uint8)


def test_png_and_pgm_give_back_every_pixel_with_size_and_seed(source):
    image = bitmap(source.chart, PER_CELL)
    np.testing.assert_array_equal(_decoded(png(image, source, Size(300))), image)
    np.testing.assert_array_equal(_decoded(pgm(image, source, Size(300))), image)
    data = png(image, source, Size(300))
    at = data.index(b"pHYs") + 4
    across, along, unit = struct.unpack(">IIB", data[at : at + 9])
    # twelve blocks are 360 mm; the format counts whole pixels per metre, here one in 4267
    assert (across, unit) == (along, 1)
    assert image.shape[1] / across == pytest.approx(0.360, rel=1 / 4267)
    assert b"seed 20120323" in pgm(image, source, Size(300))
    assert b"seed 20120323" in png(image, source, Size(300))
    inner = image[64 * PER_CELL : -64 * PER_CELL, 64 * PER_CELL : -64 * PER_CELL]
    assert inner.shape == (CELLS * PER_CELL, CELLS * PER_CELL)
    np.testing.assert_array_equal(inner[PER_CELL // 2 :: PER_CELL, PER_CELL // 2 :: PER_CELL], 255 * source.chart.cells)


@pytest.mark.parametrize("per_cell", [1, 3, 8])
def test_x_corner_is_half_black_and_stays_centred(plain: Source, per_cell: int) -> None:
    block = 32 * per_cell
    corner = bitmap(plain.chart, per_cell)[block : 2 * block, block : 2 * block]
    assert np.count_nonzero(corner == 0) == corner.size / 2
    np.testing.assert_array_equal(corner, corner[::-1, ::-1])


@pytest.mark.parametrize("per_cell", [0, -1, 33])
def test_cells_of_no_pixels_or_too_many_are_refused(plain: Source, per_cell: int) -> None:
    with pytest.raises(BadParameter, match="1 to 32 pixels"):
        bitmap(plain.chart, per_cell)
