"""Sheets of a chart printed on several sheets, with the marks for joining them.

Crosses are centred on the seams, in the bands beyond a sheet's cells, so that both sheets show each of them: if one
sheet is cut through its crosses and laid on the other, the halves complete each other.
"""

from __future__ import annotations

from procedures.outcome import BadParameter
from procedures.pattern_print.assembly import assembly_sheet
from procedures.pattern_print.outline import outline
from procedures.pattern_print.panel import Drawing, PrintedLine, Text
from procedures.pattern_print.sheet import Box, Sheet, title
from procedures.pattern_print.source import Source
from procedures.pattern_print.tiles import BAND_MM, SheetTile, Tiling

BLEED_MM = 1.5
"""Width of the cells printed beyond a seam, so that an inaccurate cut shows cells, not paper."""
ARM_MM = 3.0
"""Half the size of a cross; along the seam it extends over the whole band beyond the bleed."""
THICKNESS_MM, TYPE_MM = 0.15, 2.5
ORIGIN_LETTERS = 24
"""Number of characters of a long origin on the label."""


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
