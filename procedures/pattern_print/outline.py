"""Black areas of the chart as closed outlines.

Adjacent squares show hairlines with antialiasing, since two half covered pixels do not add up to a black one. Outlines
have no edges between black areas, so there are no hairlines.
"""

from __future__ import annotations

from collections import defaultdict
from itertools import pairwise
from math import atan2

import numpy as np
import numpy.typing as npt

from procedures.pattern import BLACK_BLOCKS, BLOCK, BLOCKS, Cells, Chart, edge_areas, triangles

Vertex = tuple[int, int]
Edge = tuple[int, int, int, int]
"""From (x, y) to (x, y)."""
Loop = list[Vertex]


def outline(chart: Chart) -> list[Loop]:
    """Closed outlines of the black areas: cells, blocks and triangles as one shape, then the slanted edges.

    Each is a list of (x, y) in cells, integers, without repetition of the first point. Black lies to the right of every
    edge, y down, so that the non-zero and the even-odd rule agree. Outlines meet in corners, never in edges.
    """
    edges = _square_edges(_black_squares(chart.cells))
    for start, end in _triangle_edges():
        if (*end, *start) in edges:
            edges.remove((*end, *start))
        else:
            edges.add((*start, *end))
    slanted = [[(int(x), int(y)) for x, y in area] for area in edge_areas()] if chart.edges else []
    return [_without_straight_points(loop) for loop in _chained(edges)] + slanted


def _black_squares(cells: Cells) -> npt.NDArray[np.bool_]:
    """Cells and black blocks on the grid of the whole chart, (320, 320)."""
    black = np.zeros((BLOCKS * BLOCK, BLOCKS * BLOCK), dtype=np.bool_)
    black[BLOCK:-BLOCK, BLOCK:-BLOCK] = cells == 0
    for column, row in BLACK_BLOCKS:
        black[row * BLOCK : (row + 1) * BLOCK, column * BLOCK : (column + 1) * BLOCK] = True
    return black


def _square_edges(black: npt.NDArray[np.bool_]) -> set[Edge]:
    """Unit edges between black and white squares."""
    step_down = np.diff(np.pad(black, 1).astype(np.int8), axis=0)[:, 1:-1]
    step_right = np.diff(np.pad(black, 1).astype(np.int8), axis=1)[1:-1, :]
    y, x = np.nonzero(step_down)
    left = step_down[y, x] < 0  # orientation
    across = np.stack([x + left, y, x + ~left, y], axis=1)
    y, x = np.nonzero(step_right)
    up = step_right[y, x] > 0
    along = np.stack([x, y + up, x, y + ~up], axis=1)
    return set(map(tuple, (np.concatenate([across, along]) - BLOCK).tolist()))


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
            loops.append(_one_loop(first, ends))
    return loops


def _one_loop(first: Vertex, ends: dict[Vertex, list[Vertex]]) -> Loop:
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
    return loop[:-1]


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
