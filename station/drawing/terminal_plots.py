"""Curves in characters: braille dots, or ASCII letters on limited terminals; bands are drawn by their two edges."""

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import shorten, wrap

import numpy as np
import numpy.typing as npt

from procedures.numerics.arrays import Array

Cells = npt.NDArray[np.int64]

GUTTER = 5
"""Columns to the left of the curves for the numbers of the vertical axis."""
BRAILLE = 0x2800
DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
"""Bits of a braille character, [row][column]."""
DASH = 4
LOW = 7
"""Height below which a label is shortened to one line."""
CUT = "..."


@dataclass(frozen=True, eq=False)
class TerminalCurve:
    """y over rising x, both (n,), NaN a gap, `band` the half-width of its error; `letter` in ASCII, dashes without
    colour."""

    x: Array
    y: Array
    band: Array | None = None
    letter: str = "*"
    dashed: bool = False
    points: bool = False


@dataclass(frozen=True)
class TerminalFrame:
    """The ranges of both axes, and the label below."""

    x: tuple[float, float]
    y: tuple[float, float]
    label: str = ""


def plot(
    curves: Sequence[TerminalCurve], frame: TerminalFrame, width: int, height: int, ascii: bool = False
) -> list[str]:
    """`height` lines of at most `width` characters: curves, ends of both axes, and whole words of the label, which
    continues below a narrow plot."""
    low, high = f"{frame.x[0]:.3g}", f"{frame.x[1]:.3g}"
    room = max(0, width - GUTTER - len(low) - len(high))
    more = wrap(frame.label, width) if len(frame.label) > room - 2 and height >= LOW and width > GUTTER else []
    more = more if len(more) <= height - LOW + 1 else []
    canvas = _Canvas(max(1, width - GUTTER), max(1, height - 1 - len(more)), 1 if ascii else 2, 1 if ascii else 4)
    for curve in curves:
        _draw(canvas, curve, frame)
    lines = canvas.letters() if ascii else canvas.braille()
    top, bottom = (f"{end:.3g}"[: GUTTER - 1] for end in frame.y[::-1])
    if top == bottom:
        top, bottom = (f"{end:.3f}".lstrip("0") for end in frame.y[::-1])
    ends = {len(lines) - 1: bottom, 0: top}
    side = "|" if ascii else "│"
    body = [f"{ends.get(i, ''):>{GUTTER - 1}.{GUTTER - 1}}{side}{line}" for i, line in enumerate(lines)]
    label = "" if more or room - 2 <= len(CUT) else shorten(frame.label, room - 2, placeholder=CUT)
    return [*body, f"{'':{GUTTER}}{low}{label:^{room}}{high}"[:width], *more]


class _Canvas:
    """Cells of `across` x `down` dots, each with the letter of its curve."""

    def __init__(self, columns: int, rows: int, across: int, down: int) -> None:
        self.across, self.down = across, down
        self.dots = np.full((rows * down, columns * across), "", dtype="<U1")

    def set(self, x: int, y: int, letter: str) -> None:
        rows, columns = self.dots.shape
        if 0 <= x < columns and 0 <= y < rows:
            self.dots[y, x] = letter

    def letters(self) -> list[str]:
        return ["".join(letter or " " for letter in row) for row in self.dots]

    def braille(self) -> list[str]:
        rows, columns = self.dots.shape
        lit = (self.dots != "").reshape(rows // 4, 4, columns // 2, 2)
        codes = np.einsum("iajb,ab->ij", lit.astype(int), np.array(DOTS))
        return ["".join(chr(BRAILLE + code) if code else " " for code in row) for row in codes]


def _draw(canvas: _Canvas, curve: TerminalCurve, frame: TerminalFrame) -> None:
    known = np.isfinite(curve.y)
    if not known.any():
        return
    x, y = curve.x[known], curve.y[known]
    if curve.points:
        for column, row in zip(_columns(canvas, x, frame), _rows(canvas, y, frame), strict=True):
            canvas.set(int(column), int(row), curve.letter)
        return
    if curve.band is not None:
        band = curve.band[known]
        for edge in (y - band, y + band):
            _trace(canvas, x, edge, frame, letter=".", every=2)
    _trace(canvas, x, y, frame, letter=curve.letter, every=DASH if curve.dashed else 0)


def _trace(canvas: _Canvas, x: Array, y: Array, frame: TerminalFrame, *, letter: str, every: int) -> None:
    """A line from column to column, filled where it is steep; half of every `every` columns are skipped."""
    first, last = _columns(canvas, np.array([x[0], x[-1]]), frame)
    columns = np.arange(max(first, 0), min(last, canvas.dots.shape[1] - 1) + 1)
    if not len(columns):
        return
    low, high = frame.x
    at = low + columns / max(canvas.dots.shape[1] - 1, 1) * (high - low)
    rows = _rows(canvas, np.interp(at, x, y), frame)
    before = rows[0]
    for column, row in zip(columns, rows, strict=True):
        if not every or column % every < every / 2:
            step = 1 if row >= before else -1
            for between in range(int(before) + step * int(row != before), int(row) + step, step):
                canvas.set(int(column), between, letter)
        before = row


def _columns(canvas: _Canvas, x: Array, frame: TerminalFrame) -> Cells:
    low, high = frame.x
    return _placed((x - low) / ((high - low) or 1.0), canvas.dots.shape[1])


def _rows(canvas: _Canvas, y: Array, frame: TerminalFrame) -> Cells:
    low, high = frame.y
    with np.errstate(over="ignore"):
        return _placed((high - y) / ((high - low) or 1.0), canvas.dots.shape[0])


def _placed(share: Array, n: int) -> Cells:
    """Fractions of an axis as dots; points beyond an end are one dot beyond it."""
    near = np.clip(share, -1.0, 2.0)
    return np.asarray(np.clip(np.rint(near * (n - 1)), -1, n), dtype=np.int64)
