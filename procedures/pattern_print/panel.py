"""Elements of a caption: lines, texts, and the panel that places them on the sheet. All in millimetres, y down."""

from dataclasses import dataclass
from typing import Literal

from reportlab.lib.utils import simpleSplit

Anchor = Literal["start", "middle", "end"]
FONT, BOLD_FONT = "Helvetica", "Helvetica-Bold"


@dataclass(frozen=True)
class PrintedLine:
    """A straight black line; ends (x, y) and thickness in mm."""

    start: tuple[float, float]
    end: tuple[float, float]
    thickness: float


@dataclass(frozen=True)
class Text:
    """A line of text: start, middle or end of its base line, and its type size, in mm."""

    x: float
    y: float
    words: str
    size: float
    bold: bool = False
    anchor: Anchor = "start"


@dataclass(frozen=True)
class Drawing:
    """Lines and texts."""

    strokes: tuple[PrintedLine, ...] = ()
    texts: tuple[Text, ...] = ()

    def __add__(self, other: "Drawing") -> "Drawing":
        return Drawing(self.strokes + other.strokes, self.texts + other.texts)


@dataclass(frozen=True)
class Panel:
    """A rectangle of the sheet with its own coordinates in mm: its top left corner, and its scale."""

    x: float
    y: float
    scale: float

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Sheet coordinates of a point in the panel."""
        return self.x + x * self.scale, self.y + y * self.scale

    def text(self, x: float, y: float, words: str, size: float, bold: bool = False, anchor: Anchor = "start") -> Text:
        """Line of text at a point in the panel."""
        return Text(*self.at(x, y), words, size * self.scale, bold, anchor)

    def rule(self, y: float, start: float, end: float, thickness: float) -> PrintedLine:
        return PrintedLine(self.at(start, y), self.at(end, y), thickness * self.scale)


def wrapped(words: str, width: float, size: float) -> list[str]:
    """Wrap words into lines no wider than `width`, which has the unit of the type size."""
    lines: list[str] = simpleSplit(words, FONT, size, width)
    return lines
