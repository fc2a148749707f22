from __future__ import annotations

import math
from itertools import combinations

import pytest
from reportlab.pdfbase.pdfmetrics import stringWidth

from procedures.outcome import BadParameter
from procedures.pattern_print.panel import BOLD_FONT, FONT, Text
from procedures.pattern_print.sheet import LARGEST_WIDTH_MM, Sheet, Size, lay_out
from procedures.pattern_print.source import Source

PDF_LIMIT_MM = 14400 / 72 * 25.4
Box = tuple[float, float, float, float]


@pytest.fixture(params=[32, 139, 140, 245, 247, 300, 350, 497, 700, 1000, LARGEST_WIDTH_MM], ids="{:g}mm".format)
def sheet(request: pytest.FixtureRequest, plain: Source) -> Sheet:
    return lay_out(plain, Size(request.param))


def _box(text: Text) -> Box:
    """Left, top, right, bottom of a line of text; capitals are 0.72 of the type, descenders 0.21."""
    width = stringWidth(text.words, BOLD_FONT if text.bold else FONT, text.size)
    left = text.x - {"start": 0.0, "middle": width / 2, "end": width}[text.anchor]
    return left, text.y - 0.72 * text.size, left + width, text.y + 0.21 * text.size


def _apart(a: Box, b: Box) -> bool:
    return a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]


def test_chart_with_its_margin_lies_on_the_paper(sheet: Sheet) -> None:
    x, y = sheet.corner_mm
    size = sheet.size
    # micrometres of rounding do not matter on paper
    assert min(x, y) >= size.quiet_mm - 1e-6
    assert x + size.whole_mm + size.quiet_mm <= sheet.width_mm + 1e-6


def test_caption_keeps_off_the_white_margin_and_the_printer_s_edge(sheet: Sheet) -> None:
    below = sheet.corner_mm[1] + sheet.size.whole_mm + sheet.size.quiet_mm
    boxes = [_box(text) for text in sheet.caption.texts]
    boxes += [(*stroke.start, *stroke.end) for stroke in sheet.caption.strokes]
    for x0, y0, x1, y1 in boxes:
        assert min(y0, y1) >= below
        assert min(x0, x1) >= 10
        assert max(x0, x1) <= sheet.width_mm - 10
        assert max(y0, y1) <= sheet.height_mm - 10


def test_nothing_is_written_over_anything_else(sheet: Sheet) -> None:
    boxes = [_box(text) for text in sheet.caption.texts]
    lines = []
    for stroke in sheet.caption.strokes:
        (x0, y0), (x1, y1) = stroke.start, stroke.end
        lines.append((min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1)))
    assert all(_apart(a, b) for a, b in combinations(boxes, 2))
    assert all(_apart(box, line) for box in boxes for line in lines)


def test_page_can_be_a_pdf(sheet: Sheet) -> None:
    assert max(sheet.width_mm, sheet.height_mm) <= PDF_LIMIT_MM


@pytest.mark.parametrize(("width_mm", "paper"), [(120, "A4"), (200, "A3"), (300, "A2"), (450, "A1"), (700, "A0")])
def test_paper_is_the_smallest_that_holds_all(plain: Source, width_mm: float, paper: str) -> None:
    assert lay_out(plain, Size(width_mm)).paper == paper


def test_size_counts_ten_blocks_of_32_cells() -> None:
    size = Size(320)
    assert (size.cell_mm, size.noise_mm, size.quiet_mm) == (1, 256, 32)


@pytest.mark.parametrize("width_mm", [0, -300, 31.9, 3600.1, math.nan, math.inf])
def test_width_that_cannot_be_printed_is_refused(width_mm: float) -> None:
    with pytest.raises(BadParameter, match="32 to 3600 mm wide"):
        Size(width_mm)
