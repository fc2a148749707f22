"""The certificate as PDF: its sections on one page of A4, set by reportlab; what is too long is set smaller."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from typing import Any

from markupsafe import Markup, escape
from reportlab.lib import colors
from reportlab.lib.pagesizes import A4
from reportlab.lib.styles import ParagraphStyle
from reportlab.lib.units import mm
from reportlab.pdfgen.canvas import Canvas
from reportlab.platypus import Frame, KeepInFrame, Paragraph, Spacer
from reportlab.platypus import Table as PrintedTable

from station.drawing import colours
from station.reports.certificate import PAGE, PRINT, certificate_page, certificate_sections
from station.reports.page import Block, Items, Note, Table
from station.reports.report import Report
from station.results.result_files import ResultFolder

MARGIN = 16 * mm
WIDTH = A4[0] - 2 * MARGIN
INK, SOFT = colors.HexColor(colours.TEXT), colors.HexColor(colours.SOFT)
PLAIN = ParagraphStyle("plain", fontName="Helvetica", fontSize=9, leading=11.5, textColor=INK)
SMALL = ParagraphStyle("small", PLAIN, fontSize=7.5, leading=9.5, textColor=SOFT)
TITLE = ParagraphStyle("title", PLAIN, fontName="Helvetica-Bold", fontSize=17, leading=21)
HEAD = ParagraphStyle("head", PLAIN, fontName="Helvetica-Bold", fontSize=10, leading=13, spaceBefore=7)
VERDICT = ParagraphStyle("verdict", PLAIN, fontName="Helvetica-Bold", fontSize=11, leading=14)
ROWS = [
    ("TOPPADDING", (0, 0), (-1, -1), 1.2),
    ("BOTTOMPADDING", (0, 0), (-1, -1), 1.2),
    ("LEFTPADDING", (0, 0), (0, -1), 0),
    ("VALIGN", (0, 0), (-1, -1), "TOP"),
    ("LINEBELOW", (0, 0), (-1, -1), 0.25, colors.HexColor(colours.RULE)),
]
SIGNATURES = [
    ("LINEABOVE", (0, 0), (0, 0), 0.5, INK),
    ("LINEABOVE", (2, 0), (2, 0), 0.5, INK),
    ("FONTSIZE", (0, 0), (-1, -1), 7.5),
    ("TEXTCOLOR", (0, 0), (-1, -1), SOFT),
]
REPLACEMENTS = {"≥": ">=", "≤": "<=", "−": "-", "σ": "sigma", "γ": "gamma", "’": "'", "“": '"', "”": '"'}
"""Letters that the fonts of every PDF reader lack."""


def certificate_pdf(report: Report) -> bytes:
    """The certificate on one page; the same bytes for the same report."""
    data = io.BytesIO()
    canvas = Canvas(data, pagesize=A4, invariant=1)
    canvas.setTitle(_letters(f"Certificate: {report.subject}"))
    canvas.setCreator("calibration-station")
    height = A4[1] - 2 * MARGIN
    story = [Paragraph("Calibration station", SMALL), Paragraph("Certificate of measurement", TITLE)]
    for section in certificate_sections(report):
        story += [Paragraph(section.heading, HEAD)] if section.heading else []
        story += [part for block in section.blocks for part in _printed(block)]
    signatures = PrintedTable([["date", "", "operator"]], (0.45 * WIDTH, 0.1 * WIDTH, 0.45 * WIDTH), style=SIGNATURES)
    whole = KeepInFrame(WIDTH, height, [*story, Spacer(1, 14 * mm), signatures], mode="shrink")
    Frame(MARGIN, MARGIN, WIDTH, height, 0, 0, 0, 0).addFromList([whole], canvas)
    canvas.showPage()
    canvas.save()
    return data.getvalue()


def write_certificate(folder: ResultFolder, report: Report) -> None:
    """Stage the certificate of a report, as a page and as a PDF."""
    folder.write(PAGE, certificate_page(report).encode())
    folder.write(PRINT, certificate_pdf(report))


def _printed(block: Block) -> Iterator[Any]:
    """A block as elements of reportlab."""
    if isinstance(block, Note):
        yield _paragraph(block.text, SMALL)
    elif isinstance(block, Items):
        yield from (_paragraph(f"- {one}", SMALL) for one in block.texts)
    elif isinstance(block, str):
        yield _paragraph(block, PLAIN)
    elif isinstance(block, Table) and block.rows:
        style = VERDICT if block.style == "verdicts" else PLAIN
        rows = [[_paragraph(cell, SMALL) for cell in block.head]] if block.head else []
        rows += [[_paragraph(first, PLAIN), *(_paragraph(cell, style) for cell in rest)] for first, *rest in block.rows]
        columns = max(map(len, rows)) - 1
        heading = 0.28 if columns == 1 else 0.4 if columns < 4 else 0.3
        yield PrintedTable(
            rows, [share * WIDTH for share in (heading, *[(1 - heading) / columns] * columns)], style=ROWS
        )


def _paragraph(text: str, style: ParagraphStyle) -> Any:
    """Text as a paragraph; a verdict in its colour, small print after a colon."""
    words = str(escape(text))
    if isinstance(text, Markup):
        words = words.replace("<small>", ": ").replace("</small>", "")
        words = re.sub(r'<span class="([\w-]*)">(.*)</span>', _coloured, words)
    return Paragraph(_letters(words), style)


def _coloured(found: re.Match[str]) -> str:
    colour = colours.VERDICT_COLOURS.get(found[1].replace("-", " "), colours.TEXT)
    return f'<font color="{colour}">{found[2]}</font>'


def _letters(text: str) -> str:
    """The same in letters that every PDF reader has a font for."""
    for letter, replacement in REPLACEMENTS.items():
        text = text.replace(letter, replacement)
    return text.encode("cp1252", "replace").decode("cp1252")
