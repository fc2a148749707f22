"""The certificate as PDF: its sections on numbered pages of A4, set by reportlab."""

import io
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from markupsafe import Markup, escape
from reportlab.lib import colors
from reportlab.lib.pagesizes import A4
from reportlab.lib.styles import ParagraphStyle
from reportlab.lib.units import mm
from reportlab.lib.utils import ImageReader
from reportlab.pdfgen.canvas import Canvas
from reportlab.platypus import BaseDocTemplate, Frame, Image, KeepTogether, PageBreak, PageTemplate, Paragraph, Spacer
from reportlab.platypus import Table as PrintedTable

from station.drawing import colours
from station.reports.certificate import PAGE, PRINT, certificate_page, certificate_sections, record_digest
from station.reports.certificate_details import CertificateDetails, signature_files
from station.reports.page import SMALL_MM, Block, Items, Note, PrintedPicture, Table
from station.reports.report import Report
from station.results.result_files import ResultFolder

MARGIN = 13 * mm
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
BESIDE = [("VALIGN", (0, 0), (-1, -1), "MIDDLE"), ("LEFTPADDING", (0, 0), (0, 0), 0)]
SIGNATURES = [
    ("LINEABOVE", (0, 0), (0, 0), 0.5, INK),
    ("LINEABOVE", (2, 0), (2, 0), 0.5, INK),
    ("FONTSIZE", (0, 0), (-1, -1), 7.5),
    ("TEXTCOLOR", (0, 0), (-1, -1), SOFT),
]
REPLACEMENTS = {"≥": ">=", "≤": "<=", "−": "-", "σ": "sigma", "γ": "gamma", "’": "'", "“": '"', "”": '"'}
"""Letters that the fonts of every PDF reader lack."""


def certificate_pdf(report: Report) -> bytes:
    """The certificate on numbered pages; the same bytes for the same report."""
    pages = _printed_pages(report, 0)[1]
    return _printed_pages(report, pages)[0]


def _printed_pages(report: Report, pages: int) -> tuple[bytes, int]:
    """The certificate and its number of pages; `pages` is the number that its pages state."""
    data = io.BytesIO()
    document = BaseDocTemplate(
        data, pagesize=A4, invariant=1, title=_letters(f"Certificate: {report.subject}"), creator="calibration-station",
        keywords=f"record-sha256 {report.record}",
    )  # fmt: skip

    def foot(canvas: Canvas, shown: BaseDocTemplate) -> None:
        canvas.setFont("Helvetica", 7.5)
        canvas.setFillColor(SOFT)
        canvas.drawString(MARGIN, MARGIN / 2, _letters(report.details.number))
        canvas.drawRightString(A4[0] - MARGIN, MARGIN / 2, f"page {shown.page} of {pages}")

    story = [Paragraph("Calibration station", SMALL), Paragraph("Certificate of measurement", TITLE)]
    for section in certificate_sections(report):
        story += [PageBreak()] if section.new_page else []
        story += [Paragraph(section.heading, HEAD)] if section.heading else []
        story += [part for block in section.blocks for part in _printed(block)]
    signed = ["date", "", _letters(report.details.authoriser or "operator")]
    signatures = PrintedTable([signed], (0.45 * WIDTH, 0.1 * WIDTH, 0.45 * WIDTH), style=SIGNATURES)
    frame = Frame(MARGIN, MARGIN, WIDTH, A4[1] - 2 * MARGIN, 0, 0, 0, 0)
    document.addPageTemplates(PageTemplate(frames=[frame], onPage=foot))
    document.build([*story, KeepTogether([Spacer(1, 9 * mm), signatures])])
    return data.getvalue(), document.page


def certificate_files(report: Report, record: Mapping[str, Any], details: CertificateDetails) -> dict[str, bytes]:
    """Page, PDF and signature of the certificate of a record, by name; the last with a signing key."""
    report = replace(report, record=record_digest(record), details=details)
    files = {PAGE: certificate_page(report).encode(), PRINT: certificate_pdf(report)}
    return {**files, **signature_files(files, report.record, details)}


def write_certificate(
    folder: ResultFolder, report: Report, record: Mapping[str, Any], details: CertificateDetails
) -> None:
    """Stage the certificate of a record, as a page and as a PDF."""
    for name, data in certificate_files(report, record, details).items():
        folder.write(name, data)


def _printed(block: Block) -> Iterator[Any]:
    if isinstance(block, Note):
        yield _paragraph(block.text, SMALL)
    elif isinstance(block, Items):
        yield from (_paragraph(f"- {text}", SMALL) for text in block.texts)
    elif isinstance(block, PrintedPicture):
        columns, rows = ImageReader(io.BytesIO(block.data)).getSize()
        width = block.width_mm * mm
        image = Image(io.BytesIO(block.data), width, width * rows / columns, hAlign="LEFT")
        caption = [_paragraph(block.caption, SMALL)] if block.caption else []
        beside = caption and block.width_mm < SMALL_MM
        yield PrintedTable([[image, *caption]], (width + 3 * mm, WIDTH - width - 3 * mm), style=BESIDE) if (
            beside) else KeepTogether([image, *caption])  # fmt: skip
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


def _coloured(match: re.Match[str]) -> str:
    colour = colours.VERDICT_COLOURS.get(match[1].replace("-", " "), colours.TEXT)
    return f'<font color="{colour}">{match[2]}</font>'


def _letters(text: str) -> str:
    """The text in letters that every PDF reader has a font for."""
    for letter, replacement in REPLACEMENTS.items():
        text = text.replace(letter, replacement)
    return text.encode("cp1252", "replace").decode("cp1252")
