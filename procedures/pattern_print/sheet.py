"""Layout of the page in millimetres: paper, position of the chart, caption.

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
"""Least width of a cell, so that an office printer's dots are small in comparison."""
SMALLEST_WIDTH_MM = SMALLEST_CELL_MM * BLOCK * BLOCKS
LARGEST_WIDTH_MM = 3600.0
"""Greatest width of a chart; with margin and caption just below the 5080 mm of a PDF page."""
QUIET_BLOCKS = 1
"""Width of the white margin around the chart, in blocks."""
EDGE_MM = 5.0
"""Unprinted margin of the paper: laser printers do not reach the outer 4.2 mm, inkjets 3 to 5 mm."""
LARGEST_TYPE = 6.0
"""Greatest scale of the caption, which grows with the sheet."""


@dataclass(frozen=True)
class Size:
    """Width of the whole chart, and derived lengths, in mm."""

    whole_mm: float

    def __post_init__(self) -> None:
        smallest = SMALLEST_WIDTH_MM
        # NaN is rejected as well
        if not smallest <= self.whole_mm <= LARGEST_WIDTH_MM:
            raise BadParameter(
                f"the chart must be {smallest:g} to {LARGEST_WIDTH_MM:g} mm wide; got {self.whole_mm:g} mm",
                f"choose a width in this range: smaller cells than {SMALLEST_CELL_MM:g} mm do not print square, and "
                "larger pages exceed the limit of PDF",
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
        """Width of the chart with its white margin, or with the slanted edges on one side."""
        beyond = (EDGE_END - CELLS - BLOCK) * self.cell_mm + EDGE_MM
        return self.whole_mm + self.quiet_mm + (beyond if edges else self.quiet_mm)

    def fits(self, paper: Paper, edges: bool) -> bool:
        """Whether the chart with its margin and caption fits on the upright paper."""
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

    paper : "A4", or "special size" beyond A0
    corner_mm : top left corner of the chart's frame
    black : black areas of the chart, in cells: see `outline`
    window_mm : left, top, right and bottom of the visible part of the chart, on a sheet that shows a part only
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
        """Top left corner of the noise region, the origin of the pattern's coordinates."""
        x, y = self.corner_mm
        block = BLOCK * self.size.cell_mm
        return x + block, y + block

    def visible_outlines(self) -> list[Loop]:
        """Outlines that may intersect the window."""
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
    """Width of the largest chart that fits on the paper with its caption, in integer millimetres.

    The paper is upright, since in landscape the caption leaves less space for every format of `PAPERS`.
    """
    smallest, largest = (Size(end).drawn_mm(edges) for end in (SMALLEST_WIDTH_MM, LARGEST_WIDTH_MM))
    room = min(paper.width_mm, paper.height_mm - PANEL_HEIGHT_MM - EDGE_MM)
    # the drawn width is linear in the chart's; the addition prevents the loss of a millimetre by rounding
    share = (room - smallest) / (largest - smallest) + 1e-12
    return float(math.floor(SMALLEST_WIDTH_MM + share * (LARGEST_WIDTH_MM - SMALLEST_WIDTH_MM)))


def check_fits(size: Size, paper: Paper, edges: bool) -> None:
    """Raise BadParameter if the chart with its caption does not fit on the paper."""
    if not size.fits(paper, edges):
        most = largest_width_mm(paper, edges)
        raise BadParameter(
            f"a chart on one sheet of {paper.name} must be at most {most:g} mm wide; got {size.whole_mm:g} mm",
            f"choose {most:g} mm or less, use larger paper, or print on several sheets (--tile)",
        )


def smallest_paper(papers: Sequence[Paper], size: Size, edges: bool) -> Paper:
    """First paper that the chart fits on with its caption, or else one of special size."""
    if fitting := next((paper for paper in papers if size.fits(paper, edges)), None):
        return fitting
    drawn = size.drawn_mm(edges)
    # larger than all papers: half the chart's width suffices for the caption
    scale = max(1.0, min(LARGEST_TYPE, size.whole_mm / 2 / PANEL_WIDTH_MM))
    width = max(drawn, PANEL_WIDTH_MM + 2 * EDGE_MM)
    return Paper("special size", math.ceil(width), math.ceil(drawn + PANEL_HEIGHT_MM * scale + EDGE_MM))


def lay_out(source: Source, size: Size, paper: Paper | None = None) -> Sheet:
    """Lay out chart, white margin and caption on upright paper, by default the smallest A sheet.

    Raises BadParameter if the chart does not fit on the paper.
    """
    edges = source.chart.edges
    paper = paper or smallest_paper(ISO_PAPERS, size, edges)
    check_fits(size, paper, edges)
    drawn, width, height = size.drawn_mm(edges), paper.width_mm, paper.height_mm
    room = (height - drawn - EDGE_MM) / PANEL_HEIGHT_MM
    across = min(size.whole_mm, width - 2 * EDGE_MM) / PANEL_WIDTH_MM
    scale = max(1.0, min(LARGEST_TYPE, room, across))  # no wider than the chart, and inside the paper
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
    """Title of the document."""
    return f"Noise chart, {source.origin}, {size}"


def titles(source: Source, size: Size) -> tuple[str, str]:
    """Two lines that identify the chart."""
    origin, words = source.origin, f"{size}"
    return origin[:1].upper() + origin[1:], words[:1].upper() + words[1:]
