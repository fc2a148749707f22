"""The certificate as PDF: one page of A4, set by reportlab; what is too long is set smaller."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any
from xml.sax.saxutils import escape

from reportlab.lib import colors
from reportlab.lib.pagesizes import A4
from reportlab.lib.styles import ParagraphStyle
from reportlab.lib.units import mm
from reportlab.pdfgen.canvas import Canvas
from reportlab.platypus import Frame, KeepInFrame, Paragraph, Spacer, Table

from station.drawing import colours
from station.reports.certificate import PAGE, PRINT, Certificate, certificate_of, certificate_page
from station.reports.pattern_report import Report
from station.results.result_files import ResultFolder

MARGIN = 16 * mm
WIDTH = A4[0] - 2 * MARGIN
INK, SOFT = colors.HexColor(colours.TEXT), colors.HexColor(colours.SOFT)
PLAIN = ParagraphStyle("plain", fontName="Helvetica", fontSize=9, leading=11.5, textColor=INK)
SMALL = ParagraphStyle("small", PLAIN, fontSize=7.5, leading=9.5, textColor=SOFT)
TITLE = ParagraphStyle("title", PLAIN, fontName="Helvetica-Bold", fontSize=17, leading=21)
HEAD = ParagraphStyle("head", PLAIN, fontName="Helvetica-Bold", fontSize=10, leading=13, spaceBefore=7)
VERDICT = ParagraphStyle("verdict", PLAIN, fontName="Helvetica-Bold", fontSize=11, leading=14)
LINE = ("LINEBELOW", (0, 0), (-1, -1), 0.25, colors.HexColor(colours.RULE))
TIGHT = [
    ("TOPPADDING", (0, 0), (-1, -1), 1.2),
    ("BOTTOMPADDING", (0, 0), (-1, -1), 1.2),
    ("LEFTPADDING", (0, 0), (0, -1), 0),
    ("VALIGN", (0, 0), (-1, -1), "TOP"),
]
OTHERWISE = {"≥": ">=", "≤": "<=", "−": "-", "σ": "sigma", "γ": "gamma", "’": "'", "“": '"', "”": '"'}
"""Letters that the fonts of every PDF reader lack."""


def certificate_pdf(report: Report) -> bytes:
    """The certificate on one page; the same bytes for the same report."""
    told = certificate_of(report)
    data = io.BytesIO()
    canvas = Canvas(data, pagesize=A4, invariant=1)
    canvas.setTitle(_letters(f"Certificate: {told.subject}"))
    canvas.setCreator("calibration-station")
    room = A4[1] - 2 * MARGIN
    story = KeepInFrame(WIDTH, room, _story(told, report), mode="shrink")
    Frame(MARGIN, MARGIN, WIDTH, room, 0, 0, 0, 0).addFromList([story], canvas)
    canvas.showPage()
    canvas.save()
    return data.getvalue()


def write_certificate(folder: ResultFolder, report: Report) -> None:
    """Stage the certificate of a report, as a page and as a PDF."""
    folder.write(PAGE, certificate_page(report).encode())
    folder.write(PRINT, certificate_pdf(report))


def _story(told: Certificate, report: Report) -> list[Any]:
    judged = str(report.judged or "")
    verdicts = [
        ("Measurement", told.measurement, colours.VERDICT_COLOURS[report.verdict]),
        (f"Specification {told.title}".strip(), told.specification, colours.VERDICT_COLOURS.get(judged, colours.TEXT)),
    ]
    return [
        Paragraph("Calibration station", SMALL),
        Paragraph("Certificate of measurement", TITLE),
        _words(", ".join(one for one in (told.subject, told.made) if one), PLAIN),
        Paragraph("Verdicts", HEAD),
        _table([[_words(name, PLAIN), _coloured(words, colour)] for name, words, colour in verdicts], (0.28, 0.72)),
        *(_words(one, SMALL) for one in told.reasons),
        *([_words("Against the limits, ± one standard uncertainty:", SMALL)] if told.limits else []),
        *(_words(f"- {one}", SMALL) for one in told.limits),
        Paragraph("Numbers", HEAD),
        _numbers(told),
        _words(_footnote(told), SMALL),
        *([Paragraph("Conditions", HEAD)] if told.conditions else []),
        _table([[_words(one.name, SMALL), _words(one.words, PLAIN)] for one in told.conditions], (0.28, 0.72)),
        Paragraph("Method and provenance", HEAD),
        _words(f"{told.method}. {told.settings}.", SMALL),
        _table([[_words(one.name, SMALL), _words(f"SHA-256 {one.words}", SMALL)] for one in told.shots], (0.3, 0.7)),
        Spacer(1, 14 * mm),
        Table([["date", "", "operator"]], (0.45 * WIDTH, 0.1 * WIDTH, 0.45 * WIDTH), style=_SIGNED),
    ]


_SIGNED = [
    ("LINEABOVE", (0, 0), (0, 0), 0.5, INK),
    ("LINEABOVE", (2, 0), (2, 0), 0.5, INK),
    ("FONTSIZE", (0, 0), (-1, -1), 7.5),
    ("TEXTCOLOR", (0, 0), (-1, -1), SOFT),
]


def _footnote(told: Certificate) -> str:
    pixel = f" Frequencies in {told.pixel}." if told.pixel else ""
    return f"± expanded uncertainty, coverage factor 2 (about 95 %).{pixel} {told.validity}"


def _numbers(told: Certificate) -> Any:
    heads = [f"{name}: {verdict}" for name, verdict in zip(told.planes, told.verdicts, strict=True)]
    rows = [[_words("", SMALL), *(_words(one, SMALL) for one in heads)]]
    rows += [[_words(one.words, PLAIN), *(_words(value, PLAIN) for value in one.values)] for one in told.rows]
    first = 0.4 if len(told.planes) < 4 else 0.3
    return _table(rows, (first, *[(1 - first) / max(len(told.planes), 1)] * len(told.planes)))


def _table(rows: list[list[Any]], shares: Sequence[float]) -> Any:
    if not rows:
        return Spacer(1, 1)
    return Table(rows, [share * WIDTH for share in shares], style=[*TIGHT, LINE])


def _coloured(words: str, colour: str) -> Any:
    whole = words[:1].upper() + words[1:]
    return Paragraph(f'<font color="{colour}">{escape(_letters(whole))}.</font>', VERDICT)


def _words(text: str, style: ParagraphStyle) -> Any:
    return Paragraph(escape(_letters(text)), style)


def _letters(text: str) -> str:
    """The same in letters that every PDF reader has a font for."""
    for letter, instead in OTHERWISE.items():
        text = text.replace(letter, instead)
    return text.encode("cp1252", "replace").decode("cp1252")
