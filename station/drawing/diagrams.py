"""A curve that explains a choice, as lines of a terminal: drawn, said, and as a table."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np

from procedures.plan import Diagram
from station.drawing.terminal_plots import Curve, Frame, plot

WIDTH, HEIGHT = 64, 11
"""Of the drawing, in characters."""


def drawn(diagram: Diagram, width: int, height: int, ascii: bool) -> list[str]:
    """The curve alone, from zero up."""
    x, y = np.array(diagram.x), np.array(diagram.y)
    frame = Frame((float(x[0]), float(x[-1])), (0.0, 1.05 * float(y.max())), diagram.label)
    return plot([Curve(x, y), Curve(x, y, letter="o", points=True)], frame, width, height, ascii=ascii)


def diagram_lines(diagram: Diagram, *, ascii: bool) -> list[str]:
    """All of it."""
    said = textwrap.wrap(diagram.say, width=96)
    return [*drawn(diagram, WIDTH, HEIGHT, ascii), "", *said, *([""] if diagram.rows else []), *_table(diagram.rows)]


def _table(rows: Sequence[Sequence[str]]) -> list[str]:
    """The rows, columns as wide as their widest entry, set to the right."""
    widths = [max(len(entry) for entry in column) for column in zip(*rows, strict=True)]
    return ["  ".join(f"{entry:>{width}}" for entry, width in zip(row, widths, strict=True)) for row in rows]
