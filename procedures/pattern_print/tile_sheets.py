"""Sheets of a chart printed on several sheets, with the marks for joining them.

Crosses are centred on the seams, in the bands beyond a sheet's cells, so that both sheets show each of them: if one
sheet is cut through its crosses and laid on the other, the halves complete each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from procedures.outcome import BadParameter
from procedures.pattern import BLOCK, BLOCKS
from procedures.pattern_print.panel import Drawing, Panel, PrintedLine, Text
from procedures.pattern_print.sheet import (
    EDGE_MM,
    HEADING,
    LARGEST_TYPE,
    LEFT,
    LEFT_END,
    PANEL_HEIGHT_MM,
    PANEL_WIDTH_MM,
    QUIET_BLOCKS,
    RIGHT,
    RIGHT_END,
    TITLE_TYPE,
    TYPE,
    Box,
    Paper,
    Sheet,
    Size,
    caption,
    numbered,
    outline,
    title,
    titles,
)
from procedures.pattern_print.source import Source

BLEED_MM = 1.5  # width of the cells printed beyond a seam, so that an inaccurate cut shows cells, not paper
ARM_MM = 3.0  # half the size of a cross; along the seam it extends over the whole band beyond the bleed
THICKNESS_MM, TYPE_MM = 0.15, 2.5
ORIGIN_LETTERS = 24  # number of characters of a long origin on the label


def tiled(source: Source, tiling: Tiling) -> list[Sheet]:
    """Assembly drawing, then the sheets row by row. Raises BadParameter if the chart has slanted edges."""
    if source.chart.edges:
        raise BadParameter(
            "a chart with slanted edges must fit on one sheet, as a seam would bend them; got several sheets",
            "choose a chart that fits on one sheet, or omit the edges",
        )
    size, paper, black = tiling.size, tiling.paper, outline(source.chart)
    sheets = [assembly_sheet(source, tiling)]
    for tile in tiling.tiles:
        left, top, right, bottom = box = _box(tiling, tile)
        bleed = [BLEED_MM if joined else 0.0 for joined in tile.joined]
        sheets.append(
            Sheet(
                paper=paper.name,
                width_mm=paper.width_mm,
                height_mm=paper.height_mm,
                size=size,
                corner_mm=(
                    left - tile.left * size.cell_mm + size.quiet_mm,
                    top - tile.top * size.cell_mm + size.quiet_mm,
                ),
                black=black,
                caption=_marks(box, tile) + _label(source, tiling, tile, box),
                title=title(source, size),
                window_mm=(left - bleed[0], top - bleed[1], right + bleed[2], bottom + bleed[3]),
            )
        )
    return sheets


def _box(tiling: Tiling, tile: SheetTile) -> Box:
    """Left, top, right and bottom of the tile's cells, centred on the paper."""
    cell, paper = tiling.size.cell_mm, tiling.paper
    width, height = (tile.right - tile.left) * cell, (tile.bottom - tile.top) * cell
    x, y = (paper.width_mm - width) / 2, (paper.height_mm - height) / 2
    return x, y, x + width, y + height


def _marks(box: Box, tile: SheetTile) -> Drawing:
    """Crosses on the seams, and the label of those to be cut."""
    left, top, right, bottom = box
    on_left, on_top, on_right, on_bottom = tile.joined
    strokes = _crosses([left] * on_left + [right] * on_right, (top, bottom), upright=True)
    strokes += _crosses([top] * on_top + [bottom] * on_bottom, (left, right), upright=False)
    words = [Text(left - 0.8, top - 6.2, "cut", TYPE_MM, anchor="end")] * on_left
    words += [Text(left - BAND_MM, top - 0.8, "cut", TYPE_MM)] * on_top
    return Drawing(tuple(strokes), tuple(words))


def _crosses(seams: list[float], ends: tuple[float, float], *, upright: bool) -> list[PrintedLine]:
    """Crosses in the bands beyond both ends of the seams, which are vertical or horizontal."""
    arms = []
    for seam in seams:
        for end, outwards in zip(ends, (-1, 1), strict=True):
            middle = end + outwards * BAND_MM / 2
            arms.append(((seam, end + outwards * (BLEED_MM + THICKNESS_MM)), (seam, end + outwards * BAND_MM)))
            arms.append(((seam - ARM_MM, middle), (seam + ARM_MM, middle)))
    return [
        PrintedLine(a, b, THICKNESS_MM) if upright else PrintedLine(a[::-1], b[::-1], THICKNESS_MM) for a, b in arms
    ]


def _label(source: Source, tiling: Tiling, tile: SheetTile, box: Box) -> Drawing:
    """Label of sheet and chart, in the band below the cells."""
    x, y = box[0] + 2 * ARM_MM, box[3] + BAND_MM - 1.5
    rows, columns, size = len(tiling.rows) - 1, len(tiling.columns) - 1, tiling.size
    lines = (
        f"{source.origin[:ORIGIN_LETTERS]}; chart {size.whole_mm:.6g} mm, cell {size.cell_mm:.4g} mm",
        f"row {tile.row + 1} of {rows}, column {tile.column + 1} of {columns}",
    )
    texts = [Text(x + 5 * TYPE_MM, y - 1.3 * TYPE_MM * up, words, TYPE_MM) for up, words in enumerate(lines)]
    return Drawing(texts=(Text(x, y, tile.name, 2 * TYPE_MM, bold=True), *texts))


# --- first page of a chart on several sheets: instructions for joining them, and the caption with the rulers ---

HEIGHT_MM = 140.0  # height of the part above the caption, on A4
SIDE_MM = LEFT_END - LEFT  # width of the drawing of the chart with its white margin
FRAME = BLOCK * QUIET_BLOCKS  # width of the white margin, in cells
TOP_MM = 18.0


def assembly_sheet(source: Source, tiling: Tiling) -> Sheet:
    """Assembly page, on the upright paper."""
    width, height = sorted((tiling.paper.width_mm, tiling.paper.height_mm))
    across, along = width - 2 * EDGE_MM, height - 2 * EDGE_MM
    scale = min(LARGEST_TYPE, across / PANEL_WIDTH_MM, along / (HEIGHT_MM + PANEL_HEIGHT_MM))
    x = (width - PANEL_WIDTH_MM * scale) / 2
    below = Panel(x, height - EDGE_MM - PANEL_HEIGHT_MM * scale, scale)
    panel = Panel(x, EDGE_MM, scale)
    sheets = "1 sheet" if len(tiling.tiles) == 1 else f"{len(tiling.tiles)} sheets"
    heading = panel.text(LEFT, 9, f"Assembly of {sheets} of {tiling.paper.name}", TITLE_TYPE, bold=True)
    _, steps = numbered(panel, TOP_MM + HEADING, "Joining", _steps(tiling), RIGHT, RIGHT_END)
    above = Drawing(texts=(heading,)) + _plan(panel, tiling) + steps
    return Sheet(
        paper=tiling.paper.name,
        width_mm=width,
        height_mm=height,
        size=tiling.size,
        corner_mm=(0.0, 0.0),
        black=[],
        caption=above + caption(below, titles(source, tiling.size), tiling.size.noise_mm),
        title=title(source, tiling.size),
    )


def _steps(tiling: Tiling) -> tuple[str, ...]:
    whole = tiling.size.whole_mm
    along = "Print all pages one-sided at 100 %. Both rulers below must measure 100 mm."
    join_row = (
        "Join each row first. Cut the left edge of every sheet but the row's first through the centres of its two "
        "crosses. Lay the sheet on the one before it, so that the crosses and the cells continue without a step, "
        "and glue it."
    )
    join_rows = (
        "Then join the rows. Cut the upper edge of every row but the first through the centres of its two outermost "
        "crosses. Lay the row on the one above it, so that the crosses and the cells continue, and glue it."
    )
    plate = "Glue the chart flat on a plate."
    check = (
        f"Measure from outer edge to outer edge of the printed frame: {whole:.5g} mm across and along, and "
        f"{whole * 2**0.5:.5g} mm along both diagonals."
    )
    rows = (join_rows,) if len(tiling.rows) > 2 else ()
    columns = (join_row,) if len(tiling.columns) > 2 else ()
    return (along, *columns, *rows, check, plate)


def _plan(panel: Panel, tiling: Tiling) -> Drawing:
    """Drawing of the sheets, the outline of the chart, and the overall dimensions."""
    unit = SIDE_MM / DRAWN_CELLS

    def line(x0: float, y0: float, x1: float, y1: float, thickness: float) -> PrintedLine:
        start, end = (panel.at(LEFT + x * unit, TOP_MM + y * unit) for x, y in ((x0, y0), (x1, y1)))
        return PrintedLine(start, end, thickness * panel.scale)

    end = DRAWN_CELLS - FRAME
    corners = ((FRAME, FRAME), (end, FRAME), (end, end), (FRAME, end), (FRAME, FRAME))
    strokes = [line(x, 0, x, DRAWN_CELLS, 0.2) for x in tiling.columns]
    strokes += [line(0, y, DRAWN_CELLS, y, 0.2) for y in tiling.rows]
    strokes += [line(*start, *to, 0.5) for start, to in pairwise(corners)]
    texts = []
    for tile in tiling.tiles:
        (x0, x1), (y0, y1) = _in_chart(tile.left, tile.right), _in_chart(tile.top, tile.bottom)
        type_mm = min(TITLE_TYPE, 0.4 * unit * min(x1 - x0, y1 - y0))
        place = LEFT + (x0 + x1) / 2 * unit, TOP_MM + (y0 + y1) / 2 * unit + 0.36 * type_mm
        texts.append(panel.text(*place, tile.name, type_mm, bold=True, anchor="middle"))
    whole, drawn = tiling.size.whole_mm, tiling.size.drawn_mm(edges=False)
    for start, y, what, mm in ((FRAME, 4.0, "chart", whole), (0, 12.0, "with its white border", drawn)):
        below, tick = DRAWN_CELLS + y / unit, 1.5 / unit
        strokes.append(line(start, below, DRAWN_CELLS - start, below, 0.15))
        strokes += [line(x, below - tick, x, below + tick, 0.15) for x in (start, DRAWN_CELLS - start)]
        words = f"{what} {mm:.5g} × {mm:.5g} mm"
        texts.append(panel.text(LEFT + SIDE_MM / 2, TOP_MM + SIDE_MM + y + 3.8, words, TYPE, anchor="middle"))
    note = f"Thin lines are seams. A cell is {tiling.size.cell_mm:.4g} mm wide."
    texts.append(panel.text(LEFT, TOP_MM + SIDE_MM + 23, note, TYPE))
    return Drawing(tuple(strokes), tuple(texts))


def _in_chart(start: int, end: int) -> tuple[int, int]:
    """Part of a tile inside the chart, or all of it if there is none; its label is centred there."""
    inner = max(start, FRAME), min(end, DRAWN_CELLS - FRAME)
    return inner if inner[0] < inner[1] else (start, end)


# --- Division of a chart into several sheets ---

AUTHORS_WIDTH_MM = 300.0  # width of the whole chart, ten blocks, printed by the authors of the method
DRAWN_CELLS = BLOCK * (BLOCKS + 2 * QUIET_BLOCKS)  # cells across the chart with its white margin
BAND_MM = 10.0  # width of the band around a sheet's cells, which is cut off or covered by the neighbour
MOST_SHEETS = 100  # greatest number of sheets that can be joined accurately


@dataclass(frozen=True)
class SheetTile:
    """Cells of one sheet: its row and column among the sheets, and its limits in cells from the margin's corner."""

    row: int
    column: int
    left: int
    top: int
    right: int
    bottom: int

    @property
    def name(self) -> str:
        """Letter of the row and number of the column, as B3."""
        return f"{chr(ord('A') + self.row)}{self.column + 1}"

    @property
    def joined(self) -> tuple[bool, bool, bool, bool]:
        """Whether another sheet adjoins on the left, above, on the right, below."""
        return self.left > 0, self.top > 0, self.right < DRAWN_CELLS, self.bottom < DRAWN_CELLS


@dataclass(frozen=True)
class Tiling:
    """A chart on several sheets.

    paper : paper in portrait or landscape orientation; columns, rows : starts of the tiles and the end of the last one,
    in cells from the top left of the white margin.
    """

    size: Size
    paper: Paper
    columns: tuple[int, ...]
    rows: tuple[int, ...]

    @property
    def tiles(self) -> list[SheetTile]:
        return [
            SheetTile(row, column, left, top, right, bottom)
            for row, (top, bottom) in enumerate(pairwise(self.rows))
            for column, (left, right) in enumerate(pairwise(self.columns))
        ]

    def __str__(self) -> str:
        rows, columns = len(self.rows) - 1, len(self.columns) - 1
        return f"{rows} × {columns} sheets of {self.paper.name} after an assembly drawing"


def tiling_of(size: Size, paper: Paper) -> Tiling:
    """Tiling with the fewest sheets, in either orientation. Raises BadParameter if too many sheets are required."""
    ways = [
        Tiling(size, way, _seams(size, way.width_mm), _seams(size, way.height_mm)) for way in (paper, paper.turned())
    ]
    best = min(ways, key=lambda tiling: len(tiling.tiles))
    if len(best.tiles) > MOST_SHEETS:
        raise BadParameter(
            f"a chart must take at most {MOST_SHEETS} sheets; {size.whole_mm:g} mm take {len(best.tiles)} of "
            f"{paper.name}",
            "choose a smaller chart, or larger paper",
        )
    return best


def _seams(size: Size, paper_mm: float) -> tuple[int, ...]:
    """Limits of the tiles along one side of the paper, between blocks if that takes no more sheets."""
    # the addition prevents that a width that fits exactly fails by rounding
    most = int((paper_mm - 2 * (EDGE_MM + BAND_MM)) / size.cell_mm + 1e-9)
    count = -(-DRAWN_CELLS // most)
    step = BLOCK if count * (most // BLOCK * BLOCK) >= DRAWN_CELLS else 1
    units = DRAWN_CELLS // step
    return tuple(step * (units * i // count) for i in range(count + 1))
