"""A chart over several sheets: its cells, each on one sheet, and the marks by which the sheets are joined."""

import re
import shutil
import subprocess
import zlib
from base64 import a85decode
from itertools import combinations
from pathlib import Path

import cv2
import numpy as np
import pytest

from procedures.outcome import BadParameter
from procedures.pattern import CELLS
from procedures.pattern_print.formats import pdf
from procedures.pattern_print.sheet import EDGE_MM, PAPERS, Sheet, Size
from procedures.pattern_print.source import Source
from procedures.pattern_print.tile_sheets import BAND_MM, DRAWN_CELLS, Tiling, tiled, tiling_of

from .boxes import apart, line_boxes, text_box

MM = 72 / 25.4
"""Points of a PDF in a millimetre."""
ROUNDING_MM = 1e-9
CHARTS = (
    (300.0, "a4"),
    (300.0, "letter"),
    (500.0, "a4"),
    (333.3, "tabloid"),
    (150.0, "a4"),
    (151.0, "a4"),
    (700.0, "letter"),
)


@pytest.fixture(params=CHARTS, ids=lambda one: f"{one[0]:g}mm-{one[1]}")
def tiling(request: pytest.FixtureRequest) -> Tiling:
    width_mm, paper = request.param
    return tiling_of(Size(width_mm), PAPERS[paper])


def test_every_cell_is_on_one_sheet_within_the_printers_edges(tiling):
    times = np.zeros((DRAWN_CELLS, DRAWN_CELLS), int)
    for tile in tiling.tiles:
        times[tile.top : tile.bottom, tile.left : tile.right] += 1
    assert (times == 1).all()
    cell, taken = tiling.size.cell_mm, 2 * (EDGE_MM + BAND_MM)
    for tile in tiling.tiles:
        assert (tile.right - tile.left) * cell <= tiling.paper.width_mm - taken + ROUNDING_MM
        assert (tile.bottom - tile.top) * cell <= tiling.paper.height_mm - taken + ROUNDING_MM


@pytest.mark.parametrize(
    ("width_mm", "paper", "rows", "columns"),
    [
        # with its border 1.2 times as wide; A4 holds 180 x 267 mm of it, turned 267 x 180
        (300, "a4", (0, 192, 384), (0, 192, 384)),
        (440, "a4", (0, 192, 384), (0, 128, 256, 384)),
        (450, "a4", (0, 128, 256, 384), (0, 128, 256, 384)),
        (500, "a4", (0, 128, 256, 384), (0, 96, 192, 288, 384)),
    ],
)
def test_seams_lie_between_blocks(width_mm: float, paper: str, rows: tuple[int, ...], columns: tuple[int, ...]) -> None:
    tiling = tiling_of(Size(width_mm), PAPERS[paper])
    assert (tiling.rows, tiling.columns) == (rows, columns)


def test_seams_are_between_blocks_or_cells_and_nothing_lies_over_anything_else(plain, tiling):
    # 660 mm with the border are 4 x 180 mm, of 104 cells each: three blocks, of which four sheets hold all 12
    assert tiling_of(Size(550), PAPERS["a4"]).columns == (0, 96, 192, 288, 384)
    # 5 sheets of 180 mm hold 5 x 77 cells, but only 5 x 2 blocks
    assert tiling_of(Size(740), PAPERS["a4"]).columns == (0, 76, 153, 230, 307, 384)
    with pytest.raises(BadParameter, match="at most 100 sheets; 3600 mm take 408 of A4") as refused:
        tiling_of(Size(3600), PAPERS["a4"])
    assert "larger paper" in refused.value.remedy
    with pytest.raises(BadParameter, match="must fit on one sheet"):
        tiled(plain.with_edges(), tiling_of(Size(300), PAPERS["a4"]))
    for sheet in tiled(plain, tiling):
        texts, lines = [text_box(text) for text in sheet.caption.texts], line_boxes(sheet.caption)
        windows = [] if sheet.window_mm is None else [sheet.window_mm]
        for left, top, right, bottom in texts + lines + windows:
            assert min(left, top) >= EDGE_MM - ROUNDING_MM
            assert right <= sheet.width_mm - EDGE_MM + ROUNDING_MM
            assert bottom <= sheet.height_mm - EDGE_MM + ROUNDING_MM
        assert all(apart(a, b) for a, b in combinations(texts, 2))
        assert all(apart(box, line) for box in texts for line in lines)
        assert all(apart(box, window) for box in texts + lines for window in windows)


def _on_chart(sheet: Sheet) -> set[tuple[float, ...]]:
    """The marks in millimetres of the chart, to a nanometre."""
    x, y = sheet.noise_corner_mm
    return {tuple(np.round(np.array(box) - [x, y, x, y], 6)) for box in line_boxes(sheet.caption)}


def test_neighbours_share_crosses_and_every_sheet_has_its_name_and_width(tiling, plain, source):
    tiles, (_, *sheets) = tiling.tiles, tiled(plain, tiling)
    for (a, first), (b, second) in combinations(zip(tiles, sheets, strict=True), 2):
        if abs(a.row - b.row) + abs(a.column - b.column) == 1:
            # two crosses of two lines each, on both ends of the seam
            assert len(_on_chart(first) & _on_chart(second)) == 4
    first, *sheets = tiled(plain, tiling)
    names = [tile.name for tile in tiling.tiles]
    for name, sheet in zip(names, sheets, strict=True):
        assert name in [text.words for text in sheet.caption.texts]
    words = [text.words for text in first.caption.texts]
    assert set(names) < set(words)
    width = f"{tiling.size.whole_mm:.5g}"
    assert f"chart {width} × {width} mm" in words
    lengths = [
        (round(right - left, 6), round(bottom - top, 6)) for left, top, right, bottom in line_boxes(first.caption)
    ]
    assert {(100, 0), (0, 100)} < set(lengths)  # the rulers, whatever the size of the type
    size = Size(300)
    data = pdf(*tiled(source, tiling_of(size, PAPERS["a4"])))
    pages = [
        zlib.decompress(a85decode(one.strip().removesuffix(b"~>"))).decode("latin-1")
        for one in re.findall(rb"stream\r?\n(.*?)endstream", data, re.DOTALL)
    ]
    scales = [
        [float(scale) for scale in one]
        for page in pages
        for one in re.findall(r"([-\d.]+) 0 0 ([-\d.]+) [-\d.]+ [-\d.]+ cm\nn ", page)
    ]
    # seven digits are written: half of the last one is 2e-7 of a cell, over the whole chart 0.06 micrometres
    assert np.allclose(scales, [(size.cell_mm * MM, -size.cell_mm * MM)] * 5, rtol=0, atol=5.1e-7)


@pytest.mark.slow
def test_joined_sheets_give_the_chart(source: Source, tmp_path: Path) -> None:
    program = shutil.which("pdftoppm")
    if program is None:
        pytest.skip("no pdftoppm here (poppler-utils): the PDF cannot be rendered")
    tiling = tiling_of(Size(300), PAPERS["a4"])
    sheets = tiled(source, tiling)
    (tmp_path / "chart.pdf").write_bytes(pdf(*sheets))
    dpi = 200
    subprocess.run([program, "-r", f"{dpi}", "-gray", "chart.pdf", "page"], cwd=tmp_path, check=True)
    pages = [cv2.imread(str(path), cv2.IMREAD_UNCHANGED) for path in sorted(tmp_path.glob("page-*.pgm"))]
    joined = np.full((DRAWN_CELLS, DRAWN_CELLS), 255, np.uint8)
    for tile, sheet, page in zip(tiling.tiles, sheets[1:], pages[1:], strict=True):
        assert page is not None
        x, y = (place - sheet.size.quiet_mm for place in sheet.corner_mm)
        rows, columns = (
            ((start + (np.arange(first, end) + 0.5) * sheet.size.cell_mm) * dpi / 25.4).astype(int)
            for start, first, end in ((y, tile.top, tile.bottom), (x, tile.left, tile.right))
        )
        joined[tile.top : tile.bottom, tile.left : tile.right] = page[np.ix_(rows, columns)]
    noise = slice(64, 64 + CELLS)
    np.testing.assert_array_equal(joined[noise, noise] > 127, source.chart.cells == 1)
