import math
from itertools import combinations

import pytest

from procedures.outcome import BadParameter
from procedures.pattern_print.sheet import (
    EDGE_MM,
    LARGEST_WIDTH_MM,
    PAPERS,
    Paper,
    Sheet,
    Size,
    check_fits,
    largest_width_mm,
    lay_out,
)
from procedures.pattern_print.source import Source

from .boxes import apart, line_boxes, text_box

PDF_LIMIT_MM = 14400 / 72 * 25.4
WIDTHS_MM = (32, 139, 145, 146, 245, 247, 300, 350, 497, 700, 1000, LARGEST_WIDTH_MM)


@pytest.fixture(params=[*WIDTHS_MM, *PAPERS], ids=lambda one: one if isinstance(one, str) else f"{one:g}mm")
def sheet(request: pytest.FixtureRequest, plain: Source) -> Sheet:
    """Charts on the smallest paper that holds them, and the largest one on each paper."""
    if isinstance(request.param, str):
        paper = PAPERS[request.param]
        return lay_out(plain, Size(largest_width_mm(paper)), paper)
    return lay_out(plain, Size(request.param))


def test_the_sheet_holds_chart_margin_and_caption_apart_also_as_a_pdf(sheet):
    x, y = sheet.corner_mm
    size = sheet.size
    # micrometres of rounding do not matter on paper
    assert min(x, y) >= size.quiet_mm - 1e-6
    assert x + size.whole_mm + size.quiet_mm <= sheet.width_mm + 1e-6
    below = sheet.corner_mm[1] + sheet.size.whole_mm + sheet.size.quiet_mm
    for left, top, right, bottom in [*map(text_box, sheet.caption.texts), *line_boxes(sheet.caption)]:
        assert top >= below
        assert left >= EDGE_MM
        assert right <= sheet.width_mm - EDGE_MM
        assert bottom <= sheet.height_mm - EDGE_MM
    boxes, lines = [text_box(text) for text in sheet.caption.texts], line_boxes(sheet.caption)
    assert all(apart(a, b) for a, b in combinations(boxes, 2))
    assert all(apart(box, line) for box in boxes for line in lines)
    assert max(sheet.width_mm, sheet.height_mm) <= PDF_LIMIT_MM


@pytest.mark.parametrize(("width_mm", "paper"), [(120, "A4"), (200, "A3"), (300, "A2"), (450, "A1"), (700, "A0")])
def test_paper_is_the_smallest_that_holds_all(plain: Source, width_mm: float, paper: str) -> None:
    assert lay_out(plain, Size(width_mm)).paper == paper


@pytest.mark.parametrize(
    ("paper", "width_mm"),
    # the chart and a block on either side of it are as wide as the paper, or leave 118 mm for the caption and 5 mm
    # below it: (297 - 123) / 1.2, (279.4 - 123) / 1.2, 594 / 1.2
    [("a4", 145), ("letter", 130), ("a1", 495)],
)
def test_the_largest_chart_of_a_paper(paper: str, width_mm: float) -> None:
    assert largest_width_mm(PAPERS[paper]) == width_mm


@pytest.mark.parametrize("edges", [False, True])
@pytest.mark.parametrize("paper", PAPERS.values(), ids=list(PAPERS))
def test_no_larger_chart_fits(paper: Paper, edges: bool) -> None:
    most = largest_width_mm(paper, edges)
    check_fits(Size(most), paper, edges)
    with pytest.raises(BadParameter, match=f"one sheet of {paper.name} must be at most {most:g} mm wide") as refused:
        check_fits(Size(most + 1), paper, edges)
    assert refused.value.remedy == f"choose {most:g} mm or less, use larger paper, or print on several sheets (--tile)"


def test_size_counts_ten_blocks_of_32_cells() -> None:
    size = Size(320)
    assert (size.cell_mm, size.noise_mm, size.quiet_mm) == (1, 256, 32)


@pytest.mark.parametrize("width_mm", [0, -300, 31.9, 3600.1, math.nan, math.inf])
def test_width_that_cannot_be_printed_is_refused(width_mm: float) -> None:
    with pytest.raises(BadParameter, match="32 to 3600 mm wide"):
        Size(width_mm)
