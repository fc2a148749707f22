"""Which cells of a chart go on which sheet, where it is printed over several."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from procedures.outcome import BadParameter
from procedures.pattern import BLOCK, BLOCKS
from procedures.pattern_print.paper import Paper
from procedures.pattern_print.sheet import EDGE_MM, QUIET_BLOCKS, Size

AUTHORS_WIDTH_MM = 300.0
"""Width of the whole chart, ten blocks, as the authors of the method printed it."""
DRAWN_CELLS = BLOCK * (BLOCKS + 2 * QUIET_BLOCKS)
"""Cells across the chart with its white margin."""
BAND_MM = 10.0
"""Width of the band around a sheet's cells, which is cut off or lies below the neighbour."""
MOST_SHEETS = 100
"""More sheets than these cannot be joined straight."""


@dataclass(frozen=True)
class Tile:
    """One sheet's cells: its row and column among the sheets, and where its cells begin and end in the white margin."""

    row: int
    column: int
    left: int
    top: int
    right: int
    bottom: int

    @property
    def name(self) -> str:
        """A letter for the row, a number for the column: B3."""
        return f"{chr(ord('A') + self.row)}{self.column + 1}"

    @property
    def joined(self) -> tuple[bool, bool, bool, bool]:
        """Whether another sheet follows on the left, above, on the right, below."""
        return self.left > 0, self.top > 0, self.right < DRAWN_CELLS, self.bottom < DRAWN_CELLS


@dataclass(frozen=True)
class Tiling:
    """A chart over several sheets.

    Attributes
    ----------
    paper : Paper
        As the cells lie on it, upright or turned.
    columns, rows : tuple of int
        Where tiles begin and the last one ends, in cells from the top left of the white margin.
    """

    size: Size
    paper: Paper
    columns: tuple[int, ...]
    rows: tuple[int, ...]

    @property
    def tiles(self) -> list[Tile]:
        """Row by row."""
        return [
            Tile(row, column, left, top, right, bottom)
            for row, (top, bottom) in enumerate(pairwise(self.rows))
            for column, (left, right) in enumerate(pairwise(self.columns))
        ]

    def __str__(self) -> str:
        rows, columns = len(self.rows) - 1, len(self.columns) - 1
        return f"{rows} × {columns} sheets of {self.paper.name} after an assembly drawing"


def tiling_of(size: Size, paper: Paper) -> Tiling:
    """The tiling with the fewest sheets, on upright paper or turned.

    Raises
    ------
    BadParameter
        If it takes too many sheets.
    """
    best = min((_tiling(size, way) for way in (paper, paper.turned())), key=lambda tiling: len(tiling.tiles))
    if len(best.tiles) > MOST_SHEETS:
        raise BadParameter(
            f"a chart is printed over at most {MOST_SHEETS} sheets; {size.whole_mm:g} mm take {len(best.tiles)} "
            f"sheets of {paper.name}",
            "order a smaller chart, or take larger paper",
        )
    return best


def _tiling(size: Size, paper: Paper) -> Tiling:
    return Tiling(size, paper, _seams(size, paper.width_mm), _seams(size, paper.height_mm))


def _seams(size: Size, paper_mm: float) -> tuple[int, ...]:
    """Where tiles begin and end along one side of the paper: between blocks where that takes no more sheets."""
    # the addition: a width that fits exactly shall not fail by rounding
    most = int((paper_mm - 2 * (EDGE_MM + BAND_MM)) / size.cell_mm + 1e-9)
    count = -(-DRAWN_CELLS // most)
    step = BLOCK if count * (most // BLOCK * BLOCK) >= DRAWN_CELLS else 1
    units = DRAWN_CELLS // step
    return tuple(step * (units * i // count) for i in range(count + 1))
