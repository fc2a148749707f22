"""A curve that explains a choice, as lines of a terminal: plot, sentence and table."""

import textwrap
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from procedures.plan import Diagram
from station.drawing.terminal_plots import TerminalCurve, TerminalFrame, plot

Plotted = Callable[[int, int, bool], list[str]]
"""Lines for a width, a height, and whether in ASCII."""
UPRIGHT = 200
"""Points of an upright line: more than the dots of a terminal."""
MARGIN = 0.2
"""Above and below a curve, as a fraction of its height."""
WIDTH, HEIGHT = 64, 11


def drawn(diagram: Diagram, width: int, height: int, ascii: bool) -> list[str]:
    """The curve alone, from zero upwards."""
    x, y = np.array(diagram.x), np.array(diagram.y)
    frame = TerminalFrame((float(x[0]), float(x[-1])), (0.0, 1.05 * float(y.max())), diagram.label)
    return plot([TerminalCurve(x, y), TerminalCurve(x, y, letter="o", points=True)], frame, width, height, ascii=ascii)


def trend(places: Sequence[float], scores: Sequence[float], label: str, best: float | None = None) -> Plotted:
    """Scores over their places, each as a point, without NaN; `best` as a dashed level, the last place as an upright
    line: you are here."""
    order = np.argsort(np.array(places, dtype=float), kind="stable")
    x, y = np.array(places, dtype=float)[order], np.array(scores, dtype=float)[order]
    known = y[np.isfinite(y)]
    low, top = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    room = MARGIN * (top - low) or MARGIN
    span = (float(x[0]), float(x[-1])) if x[-1] > x[0] else (float(x[0]) - 1, float(x[0]) + 1)
    curves = [TerminalCurve(x, y), TerminalCurve(x, y, letter="o", points=True)]
    if best is not None:
        curves.append(TerminalCurve(np.array(span), np.full(2, best), letter="-", dashed=True))
    here = float(places[-1])
    curves.append(
        TerminalCurve(np.full(UPRIGHT, here), np.linspace(low - room, top + room, UPRIGHT), letter="|", points=True)
    )
    return partial(plot, curves, TerminalFrame(span, (low - room, top + room), f"{label}; the line: you are here"))


def diagram_lines(diagram: Diagram, *, ascii: bool) -> list[str]:
    """Plot or drawing, sentence and table."""
    sentence = textwrap.wrap(diagram.say, width=96)
    widths = [max(len(entry) for entry in column) for column in zip(*diagram.rows, strict=True)]
    return [
        *(diagram.drawing.splitlines() or drawn(diagram, WIDTH, HEIGHT, ascii)),
        "",
        *sentence,
        *([""] if diagram.rows else []),
        *["  ".join(f"{entry:>{width}}" for entry, width in zip(row, widths, strict=True)) for row in diagram.rows],
    ]
