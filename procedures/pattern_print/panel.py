"""What a caption is made of: lines, texts, and the panel that places them on the sheet. All in millimetres, y down."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from reportlab.lib.utils import simpleSplit

Anchor = Literal["start", "middle", "end"]
FONT, BOLD_FONT = "Helvetica", "Helvetica-Bold"


@dataclass(frozen=True)
class Stroke:
    """A straight black line; ends (x, y) and thickness in mm."""

    start: tuple[float, float]
    end: tuple[float, float]
    thickness: float


@dataclass(frozen=True)
class Text:
    """A line of text: where its base line begins (or has its middle, or ends) and the size of its type, in mm."""

    x: float
    y: float
    words: str
    size: float
    bold: bool = False
    anchor: Anchor = "start"


@dataclass(frozen=True)
class Drawing:
    """Lines and texts together."""

    strokes: tuple[Stroke, ...] = ()
    texts: tuple[Text, ...] = ()

    def __add__(self, other: Drawing) -> Drawing:
        return Drawing(self.strokes + other.strokes, self.texts + other.texts)


@dataclass(frozen=True)
class Panel:
    """A rectangle of the sheet, drawn in its own mm: its top left corner, and how much larger it is than drawn."""

    x: float
    y: float
    scale: float

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Sheet coordinates of a place in the panel."""
        return self.x + x * self.scale, self.y + y * self.scale

    def text(self, x: float, y: float, words: str, size: float, bold: bool = False, anchor: Anchor = "start") -> Text:
        """A line of text at a place in the panel."""
        return Text(*self.at(x, y), words, size * self.scale, bold, anchor)

    def rule(self, y: float, start: float, end: float, thickness: float) -> Stroke:
        """A horizontal line in the panel."""
        return Stroke(self.at(start, y), self.at(end, y), thickness * self.scale)


def wrapped(words: str, width: float, size: float) -> list[str]:
    """The words in lines no wider than `width`, which is in the unit of the type's size."""
    lines: list[str] = simpleSplit(words, FONT, size, width)
    return lines
