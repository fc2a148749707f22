"""Division of a chart into several sheets."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from procedures.outcome import BadParameter
from procedures.pattern import BLOCK, BLOCKS
from procedures.pattern_print.paper import Paper
from procedures.pattern_print.sheet import EDGE_MM, QUIET_BLOCKS, Size

AUTHORS_WIDTH_MM = 300.0
"""Width of the whole chart, ten blocks, printed by the authors of the method."""
DRAWN_CELLS = BLOCK * (BLOCKS + 2 * QUIET_BLOCKS)
"""Cells across the chart with its white margin."""
BAND_MM = 10.0
"""Width of the band around a sheet's cells, which is cut off or covered by the neighbour."""
MOST_SHEETS = 100
"""Greatest number of sheets that can be joined accurately."""


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
        """Tiles row by row."""
        return [
            SheetTile(row, column, left, top, right, bottom)
            for row, (top, bottom) in enumerate(pairwise(self.rows))
            for column, (left, right) in enumerate(pairwise(self.columns))
        ]

    def __str__(self) -> str:
        rows, columns = len(self.rows) - 1, len(self.columns) - 1
        return f"{rows} × {columns} sheets of {self.paper.name} after an assembly drawing"


def tiling_of(size: Size, paper: Paper) -> Tiling:
    """Tiling with the fewest sheets, in portrait or landscape orientation.

    Raises BadParameter if too many sheets are required.
    """
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
