"""The certificate: one page with both verdicts and every uncertainty expanded, as HTML and as PDF."""

from __future__ import annotations

import re

import html5lib
import numpy as np
import pytest

from procedures.outcome import Verdict
from procedures.psf import Psf
from procedures.quality import Diffraction, assess
from station.reports.certificate import certificate_page, number_table
from station.reports.certificate_print import certificate_pdf
from station.reports.report import METHODS, Report, ReportLine, ReportShot
from station.results.limits import Limit, Specification
from station.results.plane_result import PlaneResult
from station.results.terms import Terms
from station.results.units import Pixels


def report_of(*names, limits=1, shots=1, reason=""):
    x = (np.arange(17) - 8) / 4
    h = np.exp(-(x[:, None] ** 2 + x**2) / 0.5)
    psf = Psf(h / h.sum(), 4, np.eye(289) * 1e-7)
    quality = assess(psf, n=9, diffraction=Diffraction(5.6, 8.0, 530), at=(0.25,))
    held = Specification((Limit("mtf50", least=0.9),) * limits, "a very sharp lens")
    verdict = Verdict.DOUBTFUL if reason else Verdict.PASS
    plain = [PlaneResult.of(one, verdict, psf, quality, pitch=2, reason=reason) for one in names]
    planes = [Terms(specification=held).apply(one, Pixels(2)) for one in plain]
    taken = [ReportShot(f"/photographs/<b>{number}.dng", f"{number:064x}") for number in range(shots)]
    lines = [ReportLine("Camera", "Nikon \u00b5 \u4e2d"), ReportLine("Temperature", "21.0 °C")]
    return Report(
        "Nikon, 50 mm", "pattern", planes, taken, {"s": 4}, lines, specification=held.title, method=METHODS["pattern"]
    )


def text_of(page):
    tree = html5lib.HTMLParser(strict=True, namespaceHTMLElements=False).parse(page)
    return " ".join(" ".join(tree.itertext()).split())


def test_certificate_tells_both_verdicts_and_expanded_uncertainties():
    report = report_of("G1")
    number = report.planes[0].numbers["mtf50_horizontal"]
    text = text_of(certificate_page(report))
    assert "Trusted, in G1." in text
    assert "Does not meet the specification." in text
    row = next(one for one in number_table(report.planes).rows if one[0].startswith("MTF50 along rows"))
    assert float(row[1].partition("±")[2]) == pytest.approx(2 * number.uncertainty, rel=0.05)  # of two digits
    assert "coverage factor 2" in text
    assert "MTF at 0.25 cycles/pixel along rows" in text
    assert "0" * 64 in text


def test_what_came_from_outside_is_text_only():
    assert "<b>" not in certificate_page(report_of("G1"))


@pytest.mark.parametrize(
    "report",
    [
        report_of("G1"),
        report_of("R", "G1", "G2", "B", limits=30, shots=40, reason="the chart's parts disagree; " * 8),
        Report("a.pgm", "pattern", [PlaneResult("Y", Verdict.REFUSED, "no chart", "show it")], [], {}),
    ],
    ids=["short", "long", "refused"],
)
def test_pdf_is_one_page_whatever_stands_on_it(report):
    data = certificate_pdf(report)
    assert data.startswith(b"%PDF-")
    assert len(re.findall(rb"/Type /Page\b", data)) == 1
    assert data == certificate_pdf(report)
