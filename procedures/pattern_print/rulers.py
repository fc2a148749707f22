"""Two rulers for checking the printed scale, across and along the paper."""

from __future__ import annotations

from procedures.pattern_print.panel import Drawing, PrintedLine, Text

LENGTH_MM = 100
THICKNESS_MM = 0.12
DIGITS_MM = 2.6


def rulers(x: float, y: float) -> Drawing:
    """Rulers of 100 mm from a common zero at (x, y), to the right and upwards, with ticks and numbers outside."""
    strokes = [
        PrintedLine((x, y), (x + LENGTH_MM, y), THICKNESS_MM),
        PrintedLine((x, y), (x, y - LENGTH_MM), THICKNESS_MM),
    ]
    texts = []
    for mm in range(LENGTH_MM + 1):
        tick = 3.0 if mm % 10 == 0 else 2.2 if mm % 5 == 0 else 1.4
        strokes.append(PrintedLine((x + mm, y), (x + mm, y + tick), THICKNESS_MM))
        strokes.append(PrintedLine((x, y - mm), (x - tick, y - mm), THICKNESS_MM))
        if mm % 10 == 0:
            words = f"{mm} mm" if mm == LENGTH_MM else f"{mm}"
            texts.append(Text(x + mm, y + tick + 2.6, words, DIGITS_MM, anchor="middle"))
            texts.append(Text(x - tick - 0.7, y - mm + 0.9, f"{mm}", DIGITS_MM, anchor="end"))
    return Drawing(tuple(strokes), tuple(texts))
