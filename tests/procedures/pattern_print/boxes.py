"""Bounding boxes of the elements of a sheet, in millimetres."""

from reportlab.pdfbase.pdfmetrics import stringWidth

from procedures.pattern_print.panel import BOLD_FONT, FONT, Drawing, Text

Box = tuple[float, float, float, float]


def text_box(text: Text) -> Box:
    """Left, top, right, bottom of a line of text; capitals are 0.72 of the type, descenders 0.21."""
    width = stringWidth(text.words, BOLD_FONT if text.bold else FONT, text.size)
    left = text.x - {"start": 0.0, "middle": width / 2, "end": width}[text.anchor]
    return left, text.y - 0.72 * text.size, left + width, text.y + 0.21 * text.size


def line_boxes(drawing: Drawing) -> list[Box]:
    """Bounding box of the lines, without their thickness."""
    return [
        (min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1))
        for (x0, y0), (x1, y1) in ((stroke.start, stroke.end) for stroke in drawing.strokes)
    ]


def apart(a: Box, b: Box) -> bool:
    """Whether two boxes are disjoint."""
    return a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]
