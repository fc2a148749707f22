"""A certificate: one printed page with camera and lens, conditions, numbers, both verdicts, method and hashes.

Uncertainties on it are expanded: two standard uncertainties, which hold about 95 % (ISO/IEC Guide 98-3, section 6.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from procedures.numbers import RADIAL, Group, in_group, label
from station.common.uncertainty_text import stated
from station.reports.page import render
from station.reports.pattern_report import METHODS, PlaneSheet, Report, ReportLine
from station.results.verdict_words import MEASUREMENT, SPECIFICATION

PAGE, PRINT = "certificate.html", "certificate.pdf"
COVERAGE = 2
"""Standard uncertainties that the expanded one has."""
NUMBERS = in_group(Group.CERTIFIED)
"""What is certified, besides the MTF at frequencies that were asked for."""
VALIDITY = {
    "edge": "The numbers are of the MTF across each plane's best edge, photosite included, at its place of the frame",
    "field": "The numbers are of the whole PSF, photosite included, at the frame's centre or over the frame",
}
"""What the numbers of a procedure hold of."""
HERE = "The numbers are of the whole PSF, photosite included, at this place of the frame"
MOST_LIMITS = 10
MOST_SHOTS = 6


@dataclass(frozen=True)
class NumberRow:
    """One number in all planes: its words with the unit, and a value with its expanded uncertainty for each plane."""

    words: str
    values: tuple[str, ...]


@dataclass(frozen=True)
class Certificate:
    """All that stands on the page, in words."""

    subject: str
    made: str
    measurement: str
    reasons: tuple[str, ...]
    specification: str
    title: str
    limits: tuple[str, ...]
    planes: tuple[str, ...]
    verdicts: tuple[str, ...]
    rows: tuple[NumberRow, ...]
    pixel: str
    conditions: tuple[ReportLine, ...]
    shots: tuple[ReportLine, ...]
    method: str
    settings: str
    validity: str


def certificate_of(report: Report) -> Certificate:
    """What a report's certificate says."""
    planes = report.planes
    first = planes[0].record if planes else None
    version = report.software.get("version") or "not installed"
    given = ", ".join(f"{name} = {value}" for name, value in report.parameters.items() if value is not None)
    return Certificate(
        subject=report.subject,
        made=report.made or next((line.words for line in report.conditions if line.name == "Taken"), ""),
        measurement=report.measurement,
        reasons=tuple(f"{one.record.name}: {one.record.reason}" for one in planes if one.record.reason),
        specification=report.against_specification or "none was given: what the lens should be is not judged",
        title=report.specification.title,
        limits=_limits(planes),
        planes=tuple(one.record.name for one in planes),
        verdicts=tuple(_verdicts(one) for one in planes),
        rows=tuple(_rows(planes)),
        pixel=f"{first.unit} {planes[0].pixel_words}" if first and first.unit == "cycles/pixel" else "",
        conditions=tuple(line for line in (*report.conditions, *report.devices)),
        shots=tuple(_shots(report)),
        method=METHODS.get(report.procedure, report.procedure),
        settings=f"{given}; calibration-station {version}",
        validity=f"{VALIDITY.get(report.procedure, HERE)}, this focus and this aperture."
        if report.procedure in METHODS
        else "",
    )


def _verdicts(sheet: PlaneSheet) -> str:
    judged = sheet.specification.judged
    return MEASUREMENT[sheet.verdict] + (f", {judged}" if judged else "")


def _limits(planes: Sequence[PlaneSheet]) -> tuple[str, ...]:
    """Limits with what they are judged by, those that are not met first; what has no room is counted."""
    told = [(sheet.record.name, one) for sheet in planes for one in sheet.specification.in_short]
    told.sort(key=lambda one: list(SPECIFICATION).index(str(one[1].judged)), reverse=True)
    words = [f"{name}: {one.words}" for name, one in told[:MOST_LIMITS]]
    rest = len(told) - MOST_LIMITS
    return (*words, f"and {rest} more, in result.json") if rest > 0 else tuple(words)


def _rows(planes: Sequence[PlaneSheet]) -> list[NumberRow]:
    rows = []
    asked = [name for one in planes for name in one.record.numbers if name.startswith("mtf_at_")]
    for name in (*NUMBERS, *(one for one in dict.fromkeys(asked) if not one.endswith(RADIAL))):
        found = [one.record.quantity(name) for one in planes]
        known = next((one for one in found if one is not None), None)
        if known is None:
            continue
        unit = "" if known.unit == "1" else f", {known.unit}"
        values = tuple("—" if one is None else stated(one.value, COVERAGE * one.uncertainty) for one in found)
        rows.append(NumberRow(label(name, planes[0].record.unit) + unit, values))
    return rows


def _shots(report: Report) -> list[ReportLine]:
    """Photographs with their hashes; what has no room is counted."""
    rest = len(report.shots) - MOST_SHOTS
    lines = [ReportLine(one.file.rpartition("/")[2], one.sha256) for one in report.shots[:MOST_SHOTS]]
    return [*lines, ReportLine(f"and {rest} more", "in result.json")] if rest > 0 else lines


def certificate_page(report: Report) -> str:
    """The certificate as HTML that prints on one page."""
    told = certificate_of(report)
    return render("certificate.html", told=told, verdict=report.verdict, judged=str(report.judged or ""))
