"""Exact area coverage of polygons on a grid of unit cells: no sampling, so no jagged edges to mistake for blur.

The cell of row i, column j covers [j, j+1] x [i, i+1]. A shape is a set of directed segments, each with a weight: it
adds its weight to everything on its right, in proportion to the area, where it runs down, and takes it away where it
runs up (Green's theorem). Outlines that coincide cancel, and a sum of shapes is one set of segments.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Segments:
    """Directed, weighted segments: starts and ends are points (x, y), (n, 2); weights (n,)."""

    starts: Array
    ends: Array
    weights: Array

    def where(self, keep: npt.NDArray[np.bool_]) -> Segments:
        """Only some of them."""
        return Segments(self.starts[keep], self.ends[keep], self.weights[keep])

    def moved(self, x: float, y: float) -> Segments:
        """The same seen from (x, y)."""
        return Segments(self.starts - (x, y), self.ends - (x, y), self.weights)

    def runs(self) -> Array:
        """Their weighted downward runs, (n,)."""
        return self.weights * (self.ends[:, 1] - self.starts[:, 1])

    def rows(self, count: int) -> Indices:
        """The row that each one's middle is in, within the first `count`, (n,)."""
        return np.clip((self.starts[:, 1] + self.ends[:, 1]) / 2, 0, count - 1).astype(np.int64)

    def inside(self, low: float, high: float) -> Segments:
        """Those that touch the rows from `low` to `high`; the others enclose nothing there."""
        y0, y1 = self.starts[:, 1], self.ends[:, 1]
        return self.where((np.maximum(y0, y1) > low) & (np.minimum(y0, y1) < high) & (y0 != y1))

    def cut(self, axis: int) -> Segments:
        """The same segments, cut wherever their coordinate `axis` (0 = x, 1 = y) is an integer."""
        source, first, last = _pieces(self.starts[:, axis], self.ends[:, axis])
        start, step = self.starts[source], (self.ends - self.starts)[source]
        return Segments(start + first[:, None] * step, start + last[:, None] * step, self.weights[source])


def outline(vertices: Array, weight: float = 1.0) -> Segments:
    """The closed outline of a simple polygon (n, 2), directed so that its inside adds `weight`."""
    ends = np.roll(vertices, -1, axis=0)
    twice_area = np.sum(vertices[:, 0] * ends[:, 1] - ends[:, 0] * vertices[:, 1])
    # with y down a positive area is walked clockwise as seen, its left side upwards
    return Segments(vertices, ends, np.full(len(vertices), -np.sign(twice_area) * weight))


def coverage(segments: Segments, shape: tuple[int, int]) -> Array:
    """The weighted area that the segments enclose in each cell, exact to rounding, (rows, columns)."""
    rows, columns = shape
    pieces = segments.inside(0, rows).cut(axis=1)
    # a piece belongs to the row of its middle: its ends are rounded, and may stick out of the grid by a hair
    middle = (pieces.starts[:, 1] + pieces.ends[:, 1]) / 2
    pieces = pieces.where((middle > 0) & (middle < rows))
    low = np.minimum(pieces.starts[:, 0], pieces.ends[:, 0])
    high = np.maximum(pieces.starts[:, 0], pieces.ends[:, 0])
    crossing = (high > 0) & (low < columns)
    jumps = _accumulate(pieces.where(crossing).cut(axis=0), rows, columns)
    left = pieces.where(high <= 0)
    jumps[:, 0] += np.bincount(left.rows(rows), left.runs(), rows)
    return np.cumsum(jumps, axis=1, out=jumps)[:, :columns]


def _pieces(a0: Array, a1: Array) -> tuple[Indices, Array, Array]:
    """For segments from a0 to a1: source, and first and last parameter in [0, 1], of the pieces between integers."""
    low = np.floor(np.minimum(a0, a1))
    count = np.maximum(np.ceil(np.maximum(a0, a1)) - low, 1).astype(np.int64)
    source = np.repeat(np.arange(len(a0)), count)
    line = low[source] + np.arange(len(source)) - np.repeat(np.cumsum(count) - count, count)
    run = (a1 - a0)[source]
    level = run == 0
    scale = np.where(level, 1.0, run)
    one, other = ((np.clip((line + step - a0[source]) / scale, 0, 1)) for step in (0, 1))
    return source, np.where(level, 0.0, np.minimum(one, other)), np.where(level, 1.0, np.maximum(one, other))


def _accumulate(pieces: Segments, rows: int, columns: int) -> Array:
    """What pieces that lie in one cell each add to it, and to all cells on its right, before summing along rows."""
    x = np.clip((pieces.starts[:, 0] + pieces.ends[:, 0]) / 2, 0, columns)
    column = np.minimum(x.astype(np.int64), columns - 1)
    beyond = pieces.runs() * (x - column)  # the part of the cell on the left of the piece is not enclosed
    place = pieces.rows(rows) * (columns + 1) + column
    where, what = np.concatenate([place, place + 1]), np.concatenate([pieces.runs() - beyond, beyond])
    total = np.bincount(where, what, rows * (columns + 1))
    return total.reshape(rows, columns + 1).astype(np.float64, copy=False)
