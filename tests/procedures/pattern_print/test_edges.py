"""Chart with slanted edges: the chart is unchanged, and two edges in white are added."""

import numpy as np
import pytest

from procedures.pattern import BLOCK, BLOCKS, CELLS, EDGES
from procedures.pattern_print.formats import bitmap, encode
from procedures.pattern_print.sheet import EDGE_MM, Size, lay_out, outline
from procedures.pattern_print.source import Source

from .filling import winding


@pytest.mark.slow
def test_edges_leave_the_chart_and_are_alike_in_outlines_and_pixels(source):
    per_cell = 2
    plain, edged = bitmap(source.chart, per_cell), bitmap(source.with_edges().chart, per_cell)
    framed = plain.shape[0]
    np.testing.assert_array_equal(edged[:framed, :framed], plain)
    assert outline(source.with_edges().chart)[:-2] == outline(source.chart)
    chart = source.with_edges().chart
    image = bitmap(chart, per_cell)
    inside = winding(outline(chart), -64 + 0.5 / per_cell, 1 / per_cell, len(image))
    outside = np.zeros(image.shape, dtype=bool)
    first = per_cell * (2 * BLOCK + CELLS + BLOCK)
    outside[:, first:] = outside[first:, :] = True
    # a side may run through a pixel's centre
    assert np.mean((inside[outside] != 0) == (image[outside] == 0)) > 0.999


def test_edges_lean_against_each_other_and_a_block_of_white_lies_before_them() -> None:
    steps = EDGES[:, 1] - EDGES[:, 0]
    np.testing.assert_array_equal(steps[0], steps[1][::-1])
    assert 5 < np.degrees(np.arctan2(steps[0][0], steps[0][1])) < 6
    assert EDGES[0, :, 0].min() == EDGES[1, :, 1].min() == BLOCK * (BLOCKS - 1) + BLOCK


@pytest.mark.slow
def test_the_usual_chart_with_edges_fits_on_the_same_paper(source: Source) -> None:
    sheet = lay_out(source.with_edges(), Size(300.0))
    assert sheet.paper == lay_out(source, Size(300.0)).paper == "A2"
    x, y = sheet.corner_mm
    size = sheet.size
    assert x >= size.quiet_mm
    right = x + (370 + BLOCK) * size.cell_mm
    assert right <= sheet.width_mm - EDGE_MM + 1e-6
    below = y + (370 + BLOCK) * size.cell_mm
    # base lines lie under their words
    assert all(below < text.y - text.size for text in sheet.caption.texts)


@pytest.mark.slow
def test_pages_and_pixels_are_written(source: Source, tmp_path) -> None:  # type: ignore[no-untyped-def]
    for ending in ("svg", "png"):
        path = tmp_path / f"chart.{ending}"
        assert encode(path, source.with_edges(), Size(300.0), 2).data != encode(path, source, Size(300.0), 2).data
