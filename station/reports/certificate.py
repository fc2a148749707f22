"""A certificate: laboratory and customer, camera and lens, conditions, numbers, both verdicts, method and hashes.

Its contents follow ISO/IEC 17025:2017, section 7.8. Uncertainties on it are expanded: two standard uncertainties, about
95 % (ISO/IEC Guide 98-3, section 6.2). Its digest is that of the record, so that `station verify` finds what it is of.
"""

import hashlib
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import matplotlib
import numpy as np
from reportlab.graphics.barcode.qrencoder import QRCode, QRErrorCorrectLevel

from procedures.numbers import (
    ENCIRCLED_ENERGY_80,
    MTF50_MERIDIONAL,
    MTF50_SAGITTAL,
    MTF_NYQUIST,
    RADIAL,
    Group,
    in_group,
    label,
)
from procedures.outcome import Quantity
from station.calibration.field import field_places
from station.common.sanitise import stated
from station.drawing.colours import INK, PLANE_COLOURS
from station.drawing.plots import bare, curve, legend, picture
from station.drawing.style import STYLE, axes_grid
from station.reports.page import Block, Items, Note, PrintedPicture, Section, Table, html, render, sentence, small
from station.reports.report import METHODS, Report, comparison, parameters_words
from station.results.comparison import MEASUREMENT, SPECIFICATION
from station.results.plane_result import PlaneResult
from station.results.result_files import RECORD, SEAL, json_text
from station.results.units import Pixels, Unit

DPI = 200
QR_VERSION = 6
"""41 x 41 modules: room for 106 bytes at error correction level M (ISO/IEC 18004)."""
QR_PIXELS, QR_RIM = 6, 4


def curves_figure(planes: Sequence[PlaneResult]) -> bytes | None:
    """The MTF of the planes with bands of 95 %, and the PSF of the first, as PNG; None without either."""
    drawn = [one for one in planes if "frequency" in one.curves and _names(one)]
    sampled = next((one for one in planes if one.samples is not None), None)
    if not drawn:
        return None
    figure, axes = axes_grid(6.9, 1.9, 1, 2, rim_in=(0.58, 0.1, 0.42, 0.24), width_ratios=(3, 1), wspace=0.1)
    left, right = axes[0]
    for plane in drawn:
        for name, dashes in zip(_names(plane), ("-", "--"), strict=False):
            colour = PLANE_COLOURS.get(plane.name, INK)
            x, y = plane.curves["frequency"], plane.curves[name]
            curve(left, x, y, plane.curves.get(f"{name}_uncertainty"), colour=colour, ls=dashes,
                  label=f"{plane.name} {name}" if name != "mtf" else plane.name)  # fmt: skip
    left.set(xlabel=f"frequency, {drawn[0].unit}", ylabel="MTF", xlim=(0, None), ylim=(0, 1.05))
    legend(left, "upper right", fontsize=7)
    bare(right)
    if sampled is not None and sampled.samples is not None:
        picture(right, sampled.samples)
        right.set_title(f"PSF, {sampled.name}")
    data = io.BytesIO()
    with matplotlib.rc_context(STYLE):
        figure.savefig(data, format="png", dpi=DPI, metadata={"Software": None})
    return data.getvalue()


def _names(plane: PlaneResult) -> list[str]:
    return [one for one in ("horizontal", "vertical", "mtf") if one in plane.curves]


def qr_code(text: str) -> bytes:
    """A text as a QR code (ISO/IEC 18004), PNG."""
    code = QRCode(QR_VERSION, QRErrorCorrectLevel.M)
    code.addData(text)
    code.make()
    modules = np.pad(np.array(code.modules, dtype=bool), QR_RIM)
    image = np.where(np.kron(modules, np.ones((QR_PIXELS, QR_PIXELS), dtype=bool)), 0, 255).astype(np.uint8)
    return cv2.imencode(".png", image)[1].tobytes()


PAGE, PRINT = "certificate.html", "certificate.pdf"
COVERAGE_FACTOR = 2
VALIDITY = {
    "edge": "The numbers are of the MTF across each plane's best edge, photosite included, at its place of the frame",
    "field": "The numbers are of the whole PSF, photosite included, at the frame's centre or over the frame",
}
HERE = "The numbers are of the whole PSF, photosite included, at this place of the frame"
AT_PLACES = (MTF50_SAGITTAL, MTF50_MERIDIONAL, MTF_NYQUIST[RADIAL], ENCIRCLED_ENERGY_80)
ASKED = ("mtf_at_", "projection_uncertainty_")
"""Beginnings of the names of numbers that depend on what was asked for."""
MAX_LIMITS = 10
MAX_SHOTS = 6
DECISION_RULE = (
    "Decision rule (ISO 14253-1, ILAC-G8): a limit is met if the number lies within it by its guard band, which is "
    "two standard uncertainties unless the specification states another; otherwise it is undecided, or not met."
)
EXTENT = (
    "The results relate only to the items named above, as they were measured. Copies of parts of this certificate need "
    "the laboratory's consent."
)
CODE = "calibration-station certificate sha256:"
"""Text of the QR code before the digest."""


def record_digest(record: Mapping[str, Any]) -> str:
    """SHA-256 of a record without the list of its files and its own hash, which include the certificate."""
    contents = {name: value for name, value in record.items() if name not in ("files", SEAL)}
    return hashlib.sha256(json_text(contents).encode()).hexdigest()


def certificate_sections(report: Report) -> list[Section]:
    """Parties, subject and verdicts, numbers, curves, conditions, method and provenance."""
    details = report.details
    laboratory = [details.laboratory, details.laboratory_address, details.accreditation]
    made = report.made or next((line.words for line in report.conditions if line.name == "Taken"), "")
    judged = report.against_specification or "none was given: what the lens should be is not judged"
    verdicts = [
        ["Measurement", _coloured(report.verdict, report.measurement)],
        [small("Specification", report.specification), _coloured(str(report.judged or ""), judged)],
    ]
    reasons = [Note(f"{plane.name}: {plane.reason}") for plane in report.planes if plane.reason]
    logo = [PrintedPicture(Path(details.logo).read_bytes(), "", 35)] if details.logo else []
    subject = Section(
        "",
        [
            *logo,
            ", ".join(one for one in laboratory if one),
            *([Table(details.lines)] if details.lines else []),
            ", ".join(one for one in (report.subject, made) if one),
        ],
    )
    lines = [[line.name, line.words] for line in (*report.conditions, *report.devices)]
    named, given = report.method or report.procedure, parameters_words(report.parameters)
    version = report.software.get("version") or "not installed"
    method = Note(f"{'. '.join(words for words in (named, given) if words)}; calibration-station {version}.")
    return [
        subject,
        Section("Verdicts", [Table(verdicts, style="verdicts"), *reasons, *_limits(report.planes)]),
        Section("Numbers", [number_table(report.planes), Note(_footnote(report)), *_curves(report.planes)]),
        *_over_the_frame(report),
        *([Section("Conditions", [Table(lines)])] if lines else []),
        Section("Method and provenance", [method, Table(_shots(report)), *_record(report)]),
    ]


def _curves(planes: Sequence[PlaneResult]) -> list[Block]:
    figure, sampled = curves_figure(planes), any(plane.samples is not None for plane in planes)
    caption = "MTF with the band that holds 95 %" + ("; PSF on its support." if sampled else ".")
    return [PrintedPicture(figure, caption, 178)] if figure else []


def _record(report: Report) -> list[Block]:
    """The digest of the record, as text and as a code."""
    if not report.record:
        return []
    how = f"Record, SHA-256 {report.record}. station verify compares this certificate with its record and originals."
    how = f"{how} {EXTENT}"
    return [PrintedPicture(qr_code(CODE + report.record), how, 20)]


def _coloured(verdict: str, words: str) -> str:
    return html('<span class="{}">{}</span>', verdict.replace(" ", "-"), sentence(words))


def _limits(planes: Sequence[PlaneResult]) -> list[Block]:
    """Limits and judgements, those that are not met first; what exceeds the room is counted."""
    limits = [(plane.name, one) for plane in planes for one in comparison(plane).in_short]
    limits.sort(key=lambda one: list(SPECIFICATION).index(str(one[1].judged)), reverse=True)
    words = [f"{name}: {one.words}" for name, one in limits[:MAX_LIMITS]]
    rest = len(limits) - MAX_LIMITS
    words += [f"and {rest} more, in result.json"] if rest > 0 else []
    if not words:
        return []
    return [Note(f"Against the limits, ± one standard uncertainty. {DECISION_RULE}"), Items(words)]


def number_table(planes: Sequence[PlaneResult]) -> Table:
    """Certified numbers in all planes, and the MTF at requested frequencies, with expanded uncertainties."""
    asked = [name for plane in planes for name in plane.numbers if name.startswith(ASKED) and not name.endswith(RADIAL)]
    rows = []
    for name in (*in_group(Group.CERTIFIED), *dict.fromkeys(asked)):
        quantities = [plane.quantity(name) for plane in planes]
        known = next((quantity for quantity in quantities if quantity is not None), None)
        if known is not None:
            unit = {"1": "", "um": ", µm"}.get(known.unit, f", {known.unit}")
            rows.append([label(name, planes[0].unit) + unit, *map(_expanded, quantities)])
    heads = []
    for plane in planes:
        judged = comparison(plane).judged
        heads.append(small(plane.name, MEASUREMENT[str(plane.verdict)] + (f", {judged}" if judged else "")))
    return Table(rows, ["", *heads], style="few" if len(planes) < 3 else "numbers")


def _over_the_frame(report: Report) -> list[Section]:
    """Numbers at the centre, the sides and the corners of the frame, in each plane with a field."""
    blocks: list[Block] = []
    for plane in report.planes:
        if (field := report.fields.get(plane.name)) is None:
            continue
        out, places = field_places(field, plane)
        rows = [[place, *(_expanded(numbers.get(name)) for name in AT_PLACES)] for place, numbers in places.items()]
        heads = [label(name, plane.unit) + (f", {name.unit}" if name.unit == "pixel" else "") for name in AT_PLACES]
        words = f"Plane {plane.name}, frequencies in {plane.unit}; sides and corners at {out:.2g} of the half sides."
        blocks += [Note(words), Table(rows, ["", *heads], style="numbers")]
    return [Section("Over the frame", blocks, new_page=True)] if blocks else []


def _expanded(quantity: Quantity | None) -> str:
    return "—" if quantity is None else stated(quantity.value, COVERAGE_FACTOR * quantity.uncertainty)


def _footnote(report: Report) -> str:
    first = report.planes[0] if report.planes else None
    pixel = ""
    if first is not None and first.unit is Unit.CYCLES and first.pitch:
        pixel = f" Frequencies in {first.unit} {Pixels(first.pitch).words}."
    known, words = report.procedure in METHODS, VALIDITY.get(report.procedure, HERE)
    validity = f" {words}, this focus and this aperture." if known else ""
    uncertain = any("±" in cell for row in number_table(report.planes).rows for cell in row)
    expanded = f"± expanded uncertainty, coverage factor {COVERAGE_FACTOR} (about 95 %)." if uncertain else ""
    return f"{expanded}{pixel}{validity}".lstrip()


def _shots(report: Report) -> list[list[str]]:
    rest = len(report.shots) - MAX_SHOTS
    names = ["/".join(shot.file.split("/")[-2 if shot.file.endswith(RECORD) else -1 :]) for shot in report.shots]
    rows = [[name, f"SHA-256 {shot.sha256}"] for name, shot in zip(names, report.shots[:MAX_SHOTS], strict=False)]
    return [*rows, [f"and {rest} more", "in result.json"]] if rest > 0 else rows


def certificate_page(report: Report) -> str:
    """The certificate as HTML."""
    return render(
        "certificate.html", subject=report.subject, record=report.record, authoriser=report.details.authoriser,
        sections=certificate_sections(report),
    )  # fmt: skip
