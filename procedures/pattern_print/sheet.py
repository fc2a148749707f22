"""The page: which paper, where the chart lies on it, and all that is drawn beside it, in millimetres.

Sheet coordinates are (x, y) in mm from the top left corner of the paper, y down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from procedures.outcome import BadParameter
from procedures.pattern import BLOCK, BLOCKS, CELLS, EDGE_END
from procedures.pattern_print.caption import PANEL_HEIGHT_MM, PANEL_WIDTH_MM, caption
from procedures.pattern_print.outline import Loop, outline
from procedures.pattern_print.panel import Drawing, Panel
from procedures.pattern_print.source import Source

DEFAULT_WIDTH_MM = 300.0
"""Width of the whole chart, ten blocks, as the authors of the method printed it."""
SMALLEST_CELL_MM = 0.1
"""Below this an office printer's dots are no longer small against a cell."""
LARGEST_WIDTH_MM = 3600.0
"""With margin and caption just under the 5080 mm that a PDF page can have."""
QUIET_BLOCKS = 1
"""White around the chart on every side, in blocks; nothing is drawn there."""
EDGE_MM = 12.0
"""What printers cannot reach at the paper's edge, and a little more."""
LARGEST_TYPE = 6.0
"""The caption is read by hand: it grows with the sheet, but no further than this."""
PAPERS_MM = (("A4", 210, 297), ("A3", 297, 420), ("A2", 420, 594), ("A1", 594, 841), ("A0", 841, 1189))


@dataclass(frozen=True)
class Size:
    """Width of the whole chart, and what follows from it; all in mm."""

    whole_mm: float

    def __post_init__(self) -> None:
        smallest = SMALLEST_CELL_MM * BLOCK * BLOCKS
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
        "A2", or "special size" beyond A0.
    corner_mm : (float, float)
        Where the chart's top left block begins.
    black : list of loops
        What is black in the chart, in cells: see `outline`.
    """

    paper: str
    width_mm: float
    height_mm: float
    size: Size
    corner_mm: tuple[float, float]
    black: list[Loop]
    caption: Drawing
    title: str

    @property
    def noise_corner_mm(self) -> tuple[float, float]:
        """Where the noise begins: the origin of the pattern's coordinates."""
        x, y = self.corner_mm
        block = BLOCK * self.size.cell_mm
        return x + block, y + block

    def __str__(self) -> str:
        return f"{self.paper}, {self.width_mm:.4g} × {self.height_mm:.4g} mm"


def lay_out(source: Source, size: Size) -> Sheet:
    """The page of a chart: the smallest A sheet, upright, that holds chart, white margin and caption."""
    drawn = size.drawn_mm(source.chart.edges)
    paper, width, height = _paper(size, drawn)
    scale = _type_scale(size, width, height, drawn)
    slack = height - drawn - PANEL_HEIGHT_MM * scale - EDGE_MM
    panel = Panel((width - PANEL_WIDTH_MM * scale) / 2, height - EDGE_MM - PANEL_HEIGHT_MM * scale, scale)
    titles = (_capital(source.origin), _capital(f"{size}"))
    return Sheet(
        paper=paper,
        width_mm=width,
        height_mm=height,
        size=size,
        corner_mm=((width - drawn) / 2 + size.quiet_mm, size.quiet_mm + slack / 2),
        black=outline(source.chart),
        caption=caption(panel, titles, size.noise_mm),
        title=f"Noise chart, {source.origin}, {size}",
    )


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def _paper(size: Size, drawn_mm: float) -> tuple[str, float, float]:
    """Name, width and height in mm of the sheet that holds a square of so many millimetres and the caption."""
    width = max(drawn_mm, PANEL_WIDTH_MM + 2 * EDGE_MM)
    height = drawn_mm + PANEL_HEIGHT_MM + EDGE_MM
    for name, paper_width, paper_height in PAPERS_MM:
        if width <= paper_width and height <= paper_height:
            return name, paper_width, paper_height
    # no paper is this large: half the chart's width is enough for the caption
    scale = max(1.0, min(LARGEST_TYPE, size.whole_mm / 2 / PANEL_WIDTH_MM))
    return "special size", math.ceil(width), math.ceil(drawn_mm + PANEL_HEIGHT_MM * scale + EDGE_MM)


def _type_scale(size: Size, width: float, height: float, drawn_mm: float) -> float:
    """How much larger than on A4 the caption may be: no wider than the chart, and inside the paper."""
    room = (height - drawn_mm - EDGE_MM) / PANEL_HEIGHT_MM
    across = min(size.whole_mm, width - 2 * EDGE_MM) / PANEL_WIDTH_MM
    return max(1.0, min(LARGEST_TYPE, room, across))
