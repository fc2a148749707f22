"""The page: which paper, where the chart lies on it, and all that is drawn beside it, in millimetres.

Sheet coordinates are (x, y) in mm from the top left corner of the paper, y down.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from procedures.outcome import BadParameter
from procedures.pattern import BLOCK, BLOCKS, CELLS, EDGE_END
from procedures.pattern_print.caption import PANEL_HEIGHT_MM, PANEL_WIDTH_MM, caption
from procedures.pattern_print.outline import Loop, outline
from procedures.pattern_print.panel import Drawing, Panel
from procedures.pattern_print.paper import ISO_PAPERS, Paper
from procedures.pattern_print.source import Source

Box = tuple[float, float, float, float]
SMALLEST_CELL_MM = 0.1
"""Below this an office printer's dots are no longer small against a cell."""
SMALLEST_WIDTH_MM = SMALLEST_CELL_MM * BLOCK * BLOCKS
LARGEST_WIDTH_MM = 3600.0
"""With margin and caption just under the 5080 mm that a PDF page can have."""
QUIET_BLOCKS = 1
"""White around the chart on every side, in blocks; nothing is drawn there."""
EDGE_MM = 5.0
"""Beside the paper's edge, where nothing is drawn: laser printers do not reach the outer 4.2 mm, inkjets 3 to 5 mm."""
LARGEST_TYPE = 6.0
"""The caption is read by hand: it grows with the sheet, but no further than this."""


@dataclass(frozen=True)
class Size:
    """Width of the whole chart, and what follows from it; all in mm."""

    whole_mm: float

    def __post_init__(self) -> None:
        smallest = SMALLEST_WIDTH_MM
        # written so that "not a number" is refused as well
        if not smallest <= self.whole_mm <= LARGEST_WIDTH_MM:
            raise BadParameter(
                f"the chart can be {smallest:g} to {LARGEST_WIDTH_MM:g} mm wide, that is ten blocks; "
                f"got {self.whole_mm:g} mm",
                f"below, a cell is smaller than {SMALLEST_CELL_MM:g} mm and does not print square; "
                "above, the page is larger than a PDF can be",
            )

    @property
    def cell_mm(self) -> float:
        """Width of one cell."""
        return self.whole_mm / (BLOCK * BLOCKS)

    @property
    def noise_mm(self) -> float:
        """Width of the noise region, eight blocks."""
        return self.cell_mm * CELLS

    @property
    def quiet_mm(self) -> float:
        """Width of the white margin around the chart."""
        return self.cell_mm * BLOCK * QUIET_BLOCKS

    def drawn_mm(self, edges: bool) -> float:
        """Width of the chart with its white margin, or with the slanted edges on one side of it."""
        beyond = (EDGE_END - CELLS - BLOCK) * self.cell_mm + EDGE_MM
        return self.whole_mm + self.quiet_mm + (beyond if edges else self.quiet_mm)

    def fits(self, paper: Paper, edges: bool) -> bool:
        """Whether the upright paper holds the chart with its white margin, and the caption below it."""
        drawn = self.drawn_mm(edges)
        return (
            max(drawn, PANEL_WIDTH_MM + 2 * EDGE_MM) <= paper.width_mm
            and drawn + PANEL_HEIGHT_MM + EDGE_MM <= paper.height_mm
        )

    def __str__(self) -> str:
        return (
            f"whole chart {self.whole_mm:.6g} mm (10 × 10 blocks), noise {self.noise_mm:.6g} mm "
            f"(256 × 256 cells), cell {self.cell_mm:.4g} mm"
        )


@dataclass(frozen=True)
class Sheet:
    """One printed page.

    Attributes
    ----------
    paper : str
        "A4", or "special size" beyond A0.
    corner_mm : (float, float)
        Where the chart's top left block begins.
    black : list of loops
        What is black in the chart, in cells: see `outline`.
    window_mm : (float, float, float, float), optional
        Left, top, right and bottom of the part of the sheet that shows the chart, where it shows a part only.
    """

    paper: str
    width_mm: float
    height_mm: float
    size: Size
    corner_mm: tuple[float, float]
    black: list[Loop]
    caption: Drawing
    title: str
    window_mm: Box | None = None

    @property
    def noise_corner_mm(self) -> tuple[float, float]:
        """Where the noise begins: the origin of the pattern's coordinates."""
        x, y = self.corner_mm
        block = BLOCK * self.size.cell_mm
        return x + block, y + block

    def shown(self) -> list[Loop]:
        """Those outlines that the window may show."""
        if self.window_mm is None:
            return self.black
        x, y = self.noise_corner_mm
        left, top, right, bottom = (
            (mm - at) / self.size.cell_mm for mm, at in zip(self.window_mm, (x, y) * 2, strict=True)
        )
        return [
            loop
            for loop in self.black
            if max(a for a, _ in loop) > left
            and min(a for a, _ in loop) < right
            and max(b for _, b in loop) > top
            and min(b for _, b in loop) < bottom
        ]

    def __str__(self) -> str:
        return f"{self.paper}, {self.width_mm:.4g} × {self.height_mm:.4g} mm"


def largest_width_mm(paper: Paper, edges: bool = False) -> float:
    """Width of the largest chart that the paper holds with its caption, in whole millimetres.

    The paper is upright: turned, the caption below leaves less room for every format of `PAPERS`.
    """
    smallest, largest = (Size(end).drawn_mm(edges) for end in (SMALLEST_WIDTH_MM, LARGEST_WIDTH_MM))
    room = min(paper.width_mm, paper.height_mm - PANEL_HEIGHT_MM - EDGE_MM)
    # the drawn width is linear in the chart's; the addition keeps rounding from costing a millimetre
    share = (room - smallest) / (largest - smallest) + 1e-12
    return float(math.floor(SMALLEST_WIDTH_MM + share * (LARGEST_WIDTH_MM - SMALLEST_WIDTH_MM)))


def check_fits(size: Size, paper: Paper, edges: bool = False) -> None:
    """Raises BadParameter where the paper does not hold the chart with its caption."""
    if not size.fits(paper, edges):
        most = largest_width_mm(paper, edges)
        raise BadParameter(
            f"a chart on one sheet of {paper.name} can be up to {most:g} mm wide; got {size.whole_mm:g} mm",
            f"order {most:g} mm or less, take larger paper, or print it over several sheets (--tile)",
        )


def smallest_paper(papers: Sequence[Paper], size: Size, edges: bool = False) -> Paper:
    """The first of the papers that holds the chart and its caption; beyond all of them, one of special size."""
    return next((paper for paper in papers if size.fits(paper, edges)), _special_paper(size, edges))


def _special_paper(size: Size, edges: bool) -> Paper:
    drawn = size.drawn_mm(edges)
    # no paper is this large: half the chart's width is enough for the caption
    scale = max(1.0, min(LARGEST_TYPE, size.whole_mm / 2 / PANEL_WIDTH_MM))
    width = max(drawn, PANEL_WIDTH_MM + 2 * EDGE_MM)
    return Paper("special size", math.ceil(width), math.ceil(drawn + PANEL_HEIGHT_MM * scale + EDGE_MM))


def lay_out(source: Source, size: Size, paper: Paper | None = None) -> Sheet:
    """The page of a chart: chart, white margin and caption on upright paper, by default the smallest A sheet.

    Raises
    ------
    BadParameter
        If the chart does not fit on the paper.
    """
    edges = source.chart.edges
    paper = paper or smallest_paper(ISO_PAPERS, size, edges)
    check_fits(size, paper, edges)
    drawn, width, height = size.drawn_mm(edges), paper.width_mm, paper.height_mm
    scale = _type_scale(size, width, height, drawn)
    slack = height - drawn - PANEL_HEIGHT_MM * scale - EDGE_MM
    panel = Panel((width - PANEL_WIDTH_MM * scale) / 2, height - EDGE_MM - PANEL_HEIGHT_MM * scale, scale)
    return Sheet(
        paper=paper.name,
        width_mm=width,
        height_mm=height,
        size=size,
        corner_mm=((width - drawn) / 2 + size.quiet_mm, size.quiet_mm + slack / 2),
        black=outline(source.chart),
        caption=caption(panel, titles(source, size), size.noise_mm),
        title=title(source, size),
    )


def title(source: Source, size: Size) -> str:
    """Of the document."""
    return f"Noise chart, {source.origin}, {size}"


def titles(source: Source, size: Size) -> tuple[str, str]:
    """Two lines that say which chart it is."""
    return _capital(source.origin), _capital(f"{size}")


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def _type_scale(size: Size, width: float, height: float, drawn_mm: float) -> float:
    """How much larger than on A4 the caption may be: no wider than the chart, and inside the paper."""
    room = (height - drawn_mm - EDGE_MM) / PANEL_HEIGHT_MM
    across = min(size.whole_mm, width - 2 * EDGE_MM) / PANEL_WIDTH_MM
    return max(1.0, min(LARGEST_TYPE, room, across))
