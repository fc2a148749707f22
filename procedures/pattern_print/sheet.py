"""Layout of the page in millimetres: paper, position of the chart, caption.

Sheet coordinates are (x, y) in mm from the top left corner of the paper, y down.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import atan2

import numpy as np

from procedures.outcome import BadParameter
from procedures.pattern import (
    AIM_S_OVER_T,
    BLACK_BLOCKS,
    BLOCK,
    BLOCKS,
    CELLS,
    EDGE_END,
    GOOD_S_OVER_T,
    Chart,
    edge_areas,
    triangles,
)
from procedures.pattern_print import distance
from procedures.pattern_print.distance import rulers
from procedures.pattern_print.panel import Drawing, Panel, PrintedLine, Text, wrapped
from procedures.pattern_print.source import Source

Box = tuple[float, float, float, float]
SMALLEST_CELL_MM = 0.1  # least width of a cell, so that an office printer's dots are small in comparison
SMALLEST_WIDTH_MM = SMALLEST_CELL_MM * BLOCK * BLOCKS
LARGEST_WIDTH_MM = 3600.0  # greatest width of a chart; with margin and caption just below the 5080 mm of a PDF page
QUIET_BLOCKS = 1  # width of the white margin around the chart, in blocks
EDGE_MM = 5.0  # unprinted margin of the paper: laser printers do not reach the outer 4.2 mm, inkjets 3 to 5 mm
LARGEST_TYPE = 6.0  # greatest scale of the caption, which grows with the sheet


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
    """Width of the largest chart that fits on the upright paper with its caption, in integer millimetres."""
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
    """Lay out chart, margin and caption on upright paper, by default the smallest A sheet. Raises BadParameter if it
    does not fit."""
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


# --- Caption below the chart: its origin, instructions for printing and photographing, and a table of distances ---

# size of the panel on A4; it is enlarged on larger sheets
PANEL_WIDTH_MM = 186.0
PANEL_HEIGHT_MM = 118.0
TYPE, SMALL, HEADING, TITLE_TYPE = 2.9, 2.5, 3.3, 5.4
LEADING = 3.8
TOP = 24.5
LEFT, LEFT_END = 15.0, 88.0
RIGHT, RIGHT_END = 97.0, PANEL_WIDTH_MM
COLUMN = 13.5

TITLE = "Noise chart for subpixel point spread functions"
PRINTING = (
    "Print at 100 %: no scaling, no fitting to the page. Both rulers must measure 100 mm.",
    "No smoothing, no image enhancement, no toner saving; finest resolution, black ink only.",
    "Matt paper: gloss reflects the lamps.",
    "Mount it flat, glued to glass or to an aluminium plate, without waves.",
    "Keep the white border, one block wide, free on all sides.",
)
PHOTOGRAPHING = (
    "RAW at the lowest ISO, on a tripod, in even light.",
    "Expose so that white stays below saturation in every plane.",
    "Keep the whole chart with its white border in the frame.",
)


def caption(panel: Panel, titles: Iterable[str], noise_mm: float) -> Drawing:
    """Caption below the chart; `titles` are two lines that identify the chart."""
    ruler_x, ruler_y = panel.at(9, PANEL_HEIGHT_MM)
    y, printing = numbered(panel, TOP, "Printing", PRINTING, LEFT, LEFT_END)
    _, photographing = numbered(panel, y + 3, "Photographing", PHOTOGRAPHING, LEFT, LEFT_END)
    texts = [panel.text(LEFT, 5, TITLE, TITLE_TYPE, bold=True)]
    texts += [panel.text(LEFT, 10.6 + 4.2 * row, words, TYPE, bold=row == 0) for row, words in enumerate(titles)]
    head = Drawing((panel.rule(17.2, LEFT, PANEL_WIDTH_MM, 0.2),), tuple(texts))
    texts = [panel.text(RIGHT, TOP, "Distance from lens to chart, in metres, for s/t = 1", HEADING, bold=True)]
    texts += [panel.text(RIGHT, TOP + y, words, SMALL) for y, words in ((5.4, "Sensor"), (12, "Photosites"))]
    for x, sensor in zip(_columns(), distance.SENSORS, strict=True):
        cells = ((5.4, sensor.format), (8.6, f"{sensor.megapixels} MP"), (12, f"{sensor.pitch_um} µm"))
        texts += [panel.text(x, TOP + y, words, SMALL, anchor="end") for y, words in cells]
    y = TOP + 13.4
    strokes: list[PrintedLine] = [panel.rule(y, RIGHT, RIGHT_END, 0.1)]
    for focal, row in zip(distance.FOCAL_LENGTHS_MM, distance.table_m(noise_mm), strict=True):
        y += 4.1
        texts.append(panel.text(RIGHT, y, f"{focal} mm lens", TYPE))
        metres = (f"{d:.1f}" if d >= 1 else f"{d:.2f}" for d in row)
        texts += [panel.text(x, y, words, TYPE, anchor="end") for x, words in zip(_columns(), metres, strict=True)]
    strokes.append(panel.rule(y + 1.6, RIGHT, RIGHT_END, 0.1))
    return (
        head
        + printing
        + photographing
        + Drawing(tuple(strokes), tuple(texts))
        + _explanation(panel, noise_mm)
        + rulers(ruler_x, ruler_y - 6.2)
    )


def numbered(
    panel: Panel, y: float, heading: str, items: Iterable[str], left: float, right: float
) -> tuple[float, Drawing]:
    """End position of a numbered list between two x positions of the panel, and the list."""
    texts = [panel.text(left, y, heading, HEADING, bold=True)]
    y += 5.4
    for number, item in enumerate(items, start=1):
        texts.append(panel.text(left, y, f"{number}", TYPE, bold=True))
        lines = _paragraph(panel, left + 4.5, y, item, right - left - 4.5)
        texts += lines
        y += LEADING * len(lines) + 0.9
    return y, Drawing(texts=tuple(texts))


def _paragraph(panel: Panel, x: float, y: float, words: str, width: float) -> list[Text]:
    lines = wrapped(words, width, TYPE)
    return [panel.text(x, y + LEADING * row, line, TYPE) for row, line in enumerate(lines)]


def _columns() -> list[float]:
    count = len(distance.SENSORS)
    return [RIGHT_END - COLUMN * (count - 1 - i) for i in range(count)]


def _explanation(panel: Panel, noise_mm: float) -> Drawing:
    low, high = GOOD_S_OVER_T
    paragraphs = (
        f"At these distances the noise, {noise_mm:.6g} mm wide, covers {distance.IDEAL_PIXELS:g} pixels of a plane, "
        f"for s={distance.SAMPLES_PER_PIXEL} samples of the PSF per pixel. A plane of a Bayer RAW has a pixel for "
        "every second photosite; with a monochrome sensor double the distance.",
        f"s/t = s × pixels / 256: {AIM_S_OVER_T:g} is best, {low:g} to {high:g} good, that is "
        f"{1 / AIM_S_OVER_T:.2g} times the distances above, or {1 / high:.2g} to {1 / low:.2g} times, as long as the "
        "noise is at least 60 pixels wide.",
        "Distance = focal length × noise width / (pixels × pixel pitch of the plane).",
    )
    y = TOP + 13.4 + 4.1 * len(distance.FOCAL_LENGTHS_MM) + 6.4
    texts: list[Text] = []
    for words in paragraphs:
        lines = _paragraph(panel, RIGHT, y, words, RIGHT_END - RIGHT)
        texts += lines
        y += LEADING * len(lines) + 0.9
    return Drawing(texts=tuple(texts))


# --- Paper formats by name, and the formats of a locale ---


@dataclass(frozen=True)
class Paper:
    """A sheet of paper, in mm; upright as listed in `PAPERS`."""

    name: str
    width_mm: float
    height_mm: float

    @property
    def key(self) -> str:
        return self.name.lower()

    def turned(self) -> Paper:
        """Sheet rotated by 90 degrees."""
        return Paper(self.name, self.height_mm, self.width_mm)


ISO_PAPERS = (
    Paper("A4", 210, 297), Paper("A3", 297, 420), Paper("A2", 420, 594), Paper("A1", 594, 841), Paper("A0", 841, 1189),
)  # fmt: skip
"""ISO 216, smallest first."""
US_PAPERS = (
    Paper("Letter", 215.9, 279.4), Paper("Legal", 215.9, 355.6), Paper("Tabloid", 279.4, 431.8),
)  # fmt: skip
"""US formats, smallest first; larger charts are printed on A sheets."""
PAPERS = {paper.key: paper for paper in ISO_PAPERS + US_PAPERS}
LETTER_TERRITORIES = frozenset(["BZ", "CA", "CL", "CO", "CR", "GT", "MX", "NI", "PA", "PH", "PR", "SV", "US", "VE"])
"""Territories where Letter is common: Unicode CLDR, supplemental data, measurementData/paperSize."""


def papers_of_locale(environ: Mapping[str, str]) -> tuple[Paper, ...]:
    """Formats for the locale, the most common first. POSIX: LC_ALL overrides LC_PAPER, which overrides LANG; empty is
    not set."""
    locale = next((value for name in ("LC_ALL", "LC_PAPER", "LANG") if (value := environ.get(name))), "")
    territory = locale.partition(".")[0].partition("@")[0].partition("_")[2]
    return US_PAPERS + ISO_PAPERS if territory.upper() in LETTER_TERRITORIES else ISO_PAPERS


def paper_named(name: str) -> Paper:
    """Paper of that name, in any case. Raises BadParameter if no paper has that name."""
    paper = PAPERS.get(name.lower())
    if paper is None:
        raise BadParameter(f"the paper must be one of {', '.join(PAPERS)}; got {name!r}", "give one of these")
    return paper


# --- Black areas of the chart as closed outlines ---
# Adjacent squares show hairlines with antialiasing, since two half covered pixels do not add up to a black one.
# Outlines have no edges between black areas, so there are no hairlines.

Vertex = tuple[int, int]
Edge = tuple[int, int, int, int]  # from (x, y) to (x, y)
Loop = list[Vertex]


def outline(chart: Chart) -> list[Loop]:
    """Closed outlines of the black areas: cells, blocks and triangles as one shape, then the slanted edges.

    Each is a list of (x, y) in cells, integers, without repetition of the first point. Black lies to the right of every
    edge, y down, so that the non-zero and the even-odd rule agree. Outlines meet in corners, never in edges.
    """
    # cells and black blocks on the grid of the whole chart, (320, 320)
    black = np.zeros((BLOCKS * BLOCK, BLOCKS * BLOCK), dtype=np.bool_)
    black[BLOCK:-BLOCK, BLOCK:-BLOCK] = chart.cells == 0
    for column, row in BLACK_BLOCKS:
        black[row * BLOCK : (row + 1) * BLOCK, column * BLOCK : (column + 1) * BLOCK] = True
    step_down = np.diff(np.pad(black, 1).astype(np.int8), axis=0)[:, 1:-1]
    step_right = np.diff(np.pad(black, 1).astype(np.int8), axis=1)[1:-1, :]
    y, x = np.nonzero(step_down)
    left = step_down[y, x] < 0  # orientation
    across = np.stack([x + left, y, x + ~left, y], axis=1)
    y, x = np.nonzero(step_right)
    up = step_right[y, x] > 0
    along = np.stack([x, y + up, x, y + ~up], axis=1)
    edges = set(map(tuple, (np.concatenate([across, along]) - BLOCK).tolist()))
    for start, end in _triangle_edges():
        if (*end, *start) in edges:
            edges.remove((*end, *start))
        else:
            edges.add((*start, *end))
    slanted = [[(int(x), int(y)) for x, y in area] for area in edge_areas()] if chart.edges else []
    return [_without_straight_points(loop) for loop in _chained(edges)] + slanted


def _triangle_edges() -> list[tuple[Vertex, Vertex]]:
    """Edges of the x-corners' triangles; bases in unit steps, as cells may adjoin them."""
    edges: list[tuple[Vertex, Vertex]] = []
    for corners in triangles():
        (x, base), (right, _), (apex_x, apex_y) = corners.astype(int).tolist()
        points = [(step, base) for step in range(x, right + 1)] + [(apex_x, apex_y), (x, base)]
        if apex_y < base:  # keep black to the right
            points.reverse()
        edges.extend(pairwise(points))
    return edges


def _chained(edges: set[Edge]) -> list[Loop]:
    ends = defaultdict(list)
    for x, y, to_x, to_y in sorted(edges):
        ends[x, y].append((to_x, to_y))
    loops = []
    for first in list(ends):
        while ends[first]:
            loop = [first, ends[first].pop()]
            while loop[-1] != first:
                choices = ends[loop[-1]]
                before, here = loop[-2:]
                if len(choices) == 1:
                    loop.append(choices.pop())
                    continue
                # where two squares meet in a corner, the sharpest right turn stays on the same square
                following = max(choices, key=lambda after: _turn(before, here, after))
                choices.remove(following)
                loop.append(following)
            loops.append(loop[:-1])
    return loops


def _turn(before: Vertex, here: Vertex, after: Vertex) -> float:
    """Angle from one edge to the next in radians, to the right positive."""
    a, b = here[0] - before[0], here[1] - before[1]
    c, d = after[0] - here[0], after[1] - here[1]
    return atan2(a * d - b * c, a * c + b * d)


def _without_straight_points(loop: Loop) -> Loop:
    neighbours = zip(loop[-1:] + loop[:-1], loop, loop[1:] + loop[:1], strict=True)
    return [
        here for (a, b), here, (c, d) in neighbours if (here[0] - a) * (d - here[1]) != (here[1] - b) * (c - here[0])
    ]
