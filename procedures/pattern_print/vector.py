"""Encoding of sheets as PDF and SVG: the chart as one filled path in exact millimetres, the caption as text."""

from __future__ import annotations

import io
from collections.abc import Iterator
from itertools import pairwise
from xml.sax.saxutils import escape

from reportlab.lib.units import mm
from reportlab.pdfgen.canvas import Canvas

from procedures.pattern_print.outline import Loop
from procedures.pattern_print.panel import BOLD_FONT, FONT, Text
from procedures.pattern_print.sheet import Sheet

PDF_DRAW = {"start": "drawString", "middle": "drawCentredString", "end": "drawRightString"}


def pdf(*sheets: Sheet) -> bytes:
    """Encode the sheets as a PDF with a page for each; equal sheets give equal bytes."""
    file = io.BytesIO()
    # invariant: no date and no random identifier
    canvas = Canvas(file, invariant=1)
    canvas.setTitle(sheets[0].title)
    canvas.setSubject("Print at 100 %, without scaling or smoothing")
    canvas.setCreator("calibration-station")
    canvas.setViewerPreference("PrintScaling", "None")
    canvas.setViewerPreference("Duplex", "Simplex")
    for sheet in sheets:
        canvas.setPageSize((sheet.width_mm * mm, sheet.height_mm * mm))
        _pdf_chart(canvas, sheet)
        _pdf_caption(canvas, sheet)
        canvas.showPage()
    canvas.save()
    return file.getvalue()


def _pdf_chart(canvas: Canvas, sheet: Sheet) -> None:
    x, y = sheet.noise_corner_mm
    cell = sheet.size.cell_mm * mm
    canvas.saveState()
    if sheet.window_mm is not None:
        left, top, right, bottom = (end * mm for end in sheet.window_mm)
        clip = canvas.beginPath()
        clip.rect(left, sheet.height_mm * mm - bottom, right - left, bottom - top)
        canvas.clipPath(clip, stroke=0)
    # unit of one cell, y down: the path consists of integers
    canvas.transform(cell, 0, 0, -cell, x * mm, (sheet.height_mm - y) * mm)
    # literal, as the canvas would format each of 50 000 integers as a length, which takes 0.25 s
    operators = ["n"]
    for (x0, y0), *others in sheet.visible_outlines():
        operators += [f"{x0} {y0} m", *(f"{a} {b} l" for a, b in others), "h"]
    canvas.addLiteral(" ".join([*operators, "f*"]))
    canvas.restoreState()


def _pdf_caption(canvas: Canvas, sheet: Sheet) -> None:
    for stroke in sheet.caption.strokes:
        (x0, y0), (x1, y1) = stroke.start, stroke.end
        canvas.setLineWidth(stroke.thickness * mm)
        canvas.line(x0 * mm, (sheet.height_mm - y0) * mm, x1 * mm, (sheet.height_mm - y1) * mm)
    for text in sheet.caption.texts:
        canvas.setFont(BOLD_FONT if text.bold else FONT, text.size * mm)
        getattr(canvas, PDF_DRAW[text.anchor])(text.x * mm, (sheet.height_mm - text.y) * mm, text.words)


def svg(sheet: Sheet) -> bytes:
    """Encode a sheet as SVG with `viewBox` in mm, so that one unit is one millimetre."""
    width, height = f"{sheet.width_mm:.6g}", f"{sheet.height_mm:.6g}"
    x, y = sheet.noise_corner_mm
    place = f"translate({x:.9g} {y:.9g}) scale({sheet.size.cell_mm:.9g})"
    extent = f'width="{width}mm" height="{height}mm" viewBox="0 0 {width} {height}"'
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" {extent}>',
        f"<title>{escape(sheet.title)}</title>",
        f'<rect width="{width}" height="{height}" fill="#fff"/>',
        f'<path id="chart" fill="#000" transform="{place}" d="{"".join(map(_svg_loop, sheet.black))}"/>',
        *_svg_caption(sheet),
        "</svg>\n",
    ]
    return "\n".join(lines).encode()


def _svg_loop(loop: Loop) -> str:
    """SVG path of a loop, with relative steps from a corner."""
    x, y = loop[0]
    return f"M{x} {y}" + "".join(_svg_step(x1 - x0, y1 - y0) for (x0, y0), (x1, y1) in pairwise(loop)) + "z"


def _svg_step(dx: int, dy: int) -> str:
    if dy == 0:
        return f"h{dx}"
    return f"v{dy}" if dx == 0 else f"l{dx} {dy}"


def _svg_caption(sheet: Sheet) -> Iterator[str]:
    yield '<g id="lines" stroke="#000">'
    for stroke in sheet.caption.strokes:
        (x0, y0), (x1, y1) = stroke.start, stroke.end
        ends = f'x1="{x0:.6f}" y1="{y0:.6f}" x2="{x1:.6f}" y2="{y1:.6f}"'
        yield f'<line {ends} stroke-width="{stroke.thickness:.4f}"/>'
    yield '</g>\n<g id="texts" font-family="Helvetica, Arial, sans-serif">'
    yield from map(_svg_text, sheet.caption.texts)
    yield "</g>"


def _svg_text(text: Text) -> str:
    weight = ' font-weight="bold"' if text.bold else ""
    anchor = "" if text.anchor == "start" else f' text-anchor="{text.anchor}"'
    place = f'x="{text.x:.4f}" y="{text.y:.4f}" font-size="{text.size:.4f}"'
    return f"<text {place}{weight}{anchor}>{escape(text.words)}</text>"
