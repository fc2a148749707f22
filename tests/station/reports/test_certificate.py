"""The certificate: one page with both verdicts and every uncertainty expanded, as HTML and as PDF."""

import base64
import re

import cv2
import html5lib
import numpy as np
import pytest

from procedures import BadParameter, Diffraction, Verdict, assess
from station.reports.certificate import CODE, certificate_page, number_table, record_digest
from station.reports.certificate_details import CertificateDetails
from station.reports.certificate_print import certificate_files, certificate_pdf
from station.reports.report import METHODS, Report, ReportLine, ReportShot
from station.results.limits import Limit, Specification
from station.results.plane_result import PlaneResult
from station.results.terms import Terms
from station.results.units import Pixels
from tests.psfs import gaussian


def report_of(*names, limits=1, shots=1, reason=""):
    psf = gaussian(0.5, sd=3e-4)
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


def test_the_certificate_has_both_verdicts_and_outside_text_only_as_text():
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
def test_pages_of_the_pdf_are_numbered(report):
    data = certificate_pdf(report)
    assert data.startswith(b"%PDF-")
    assert len(re.findall(rb"/Type /Page\b", data)) in (1, 2)
    assert data == certificate_pdf(report)


def test_certificate_states_laboratory_customer_and_the_digest_of_the_record(tmp_path):
    toml = tmp_path / "certificate.toml"
    logo = cv2.imencode(".png", np.zeros((8, 16, 3), np.uint8))[1].tobytes()
    (tmp_path / "logo.png").write_bytes(logo)
    toml.write_text('laboratory = "Optics <lab>"\nlogo = "logo.png"\nnumber = "2026-7"\ncustomer = "A & B"\n')
    record = {"schema": "station/psf/1", "planes": {}, "files": {"a": "b"}}
    files = certificate_files(report_of("G1"), record, CertificateDetails.read(toml))
    page = files["certificate.html"].decode()
    text = text_of(page)
    digest = record_digest({"schema": "station/psf/1", "planes": {}})
    assert all(one in text for one in ("Optics <lab>", "2026-7", "A & B", digest))
    assert base64.b64encode(logo).decode() in page
    codes = [cv2.imdecode(np.frombuffer(base64.b64decode(one), np.uint8), 0)
             for one in re.findall(r"data:image/png;base64,([^\"]+)", page)]  # fmt: skip
    sizes = [cv2.resize(codes[-1], None, fx=one, fy=one, interpolation=cv2.INTER_AREA) for one in (1 / 2, 2 / 3, 1)]
    assert CODE + digest in [cv2.QRCodeDetector().detectAndDecode(one)[0] for one in sizes]  # it misses some sizes
    assert f"record-sha256 {digest}".encode() in files["certificate.pdf"]


@pytest.mark.parametrize("text", ['customre = "A"', "number = 7", 'logo = "nowhere.png"'])
def test_wrong_details_are_refused_with_the_name_of_the_file(tmp_path, text):
    toml = tmp_path / "mine.toml"
    toml.write_text(text)
    with pytest.raises(BadParameter, match=r"mine\.toml|customre|number"):
        CertificateDetails.read(toml)


def test_a_logo_that_is_no_whole_image_is_refused_before_the_measurement(tmp_path):
    toml, logo = tmp_path / "mine.toml", tmp_path / "logo.png"
    toml.write_text('logo = "logo.png"')
    image = cv2.imencode(".png", np.arange(10_000, dtype=np.uint8).reshape(100, 100))[1].tobytes()
    for data in (b"text", image[: len(image) // 2]):
        logo.write_bytes(data)
        with pytest.raises(BadParameter, match="which is no whole PNG or JPEG image"):
            CertificateDetails.read(toml)
