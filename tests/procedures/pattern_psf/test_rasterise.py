import numpy as np
import pytest

from procedures.pattern import BLACK_BLOCKS, BLOCK, CELLS, WHITE_BLOCKS, X_CORNER_BLOCKS, Chart
from procedures.pattern_psf.rasterise import Window, band_limited_chart, frame_cells, whole_chart

from .conftest import CHART, Bench


def test_frame_and_x_corners_are_rasterised_where_the_chart_has_them():
    cells = frame_cells()
    for blocks, value in ((BLACK_BLOCKS, 0.0), (WHITE_BLOCKS, 1.0)):
        for column, row in blocks:
            block = cells[row * BLOCK : (row + 1) * BLOCK, column * BLOCK : (column + 1) * BLOCK]
            assert (block == value).all()
    column, row = X_CORNER_BLOCKS[1]
    block = frame_cells()[row * BLOCK : (row + 1) * BLOCK, column * BLOCK : (column + 1) * BLOCK]
    assert block.mean() == 0.5
    assert block[0].sum() == 1.0  # the upper base is black but for its two half cells
    assert (block == block[::-1]).all()
    assert (block == block[:, ::-1]).all()


def test_raster_of_a_plain_chart_is_its_value(bench: Bench) -> None:
    _, registration = bench.marks()
    white = Chart(np.ones((CELLS, CELLS), dtype=np.uint8))
    raster = band_limited_chart(white, registration, 4)
    x, y = registration.centre.astype(int)
    # ringing of the frame's edges falls as one over the distance: 40 pixels of 4 samples away
    assert raster.read(registration, Window(x - 5, y - 5, 10, 10), 0) == pytest.approx(0.5, abs=0.01)


def test_raster_blurred_is_the_photograph(bench: Bench) -> None:
    # what the simulator draws from outlines, the raster convolved with the same PSF must give
    samples = bench.clean
    _, registration = bench.marks()
    window = Window(70, 65, 60, 60)
    s, k = 4, 33
    u = band_limited_chart(CHART, registration, s).read(registration, window, k // 2)
    h = bench.photograph.true_psf("Y", s, k).h
    model = np.array(
        [[np.sum(u[s * i : s * i + k, s * j : s * j + k] * h[::-1, ::-1]) for j in range(60)] for i in range(60)]
    )
    # the marks' map errs by some hundredths of a pixel on this tilted chart, which limits the correlation
    assert np.corrcoef(model.ravel(), samples[65:125, 70:130].ravel())[0, 1] > 0.985


def test_whole_chart_holds_the_cells() -> None:
    assert (whole_chart(CHART)[BLOCK : BLOCK + CELLS, BLOCK : BLOCK + CELLS] == CHART.cells).all()
