"""A calibration's page: what it says, that it stands alone, and how a browser shows it."""

import re
from dataclasses import replace
from types import SimpleNamespace

import html5lib
import numpy as np
import pytest

from procedures import Chart, Diffraction, PatternParameters, read_frame
from procedures.outcome import BadParameter, Outcome, Quantity, Verdict
from station.calibration.planes import calibrate
from station.reports.otf_figures import mtf_figure
from station.reports.psf_page import psf_page
from station.reports.report import Report, ReportLine, ReportShot
from station.reports.report_page import curves_over
from station.results.limits import Limit, Specification
from station.results.overlay import Overlay
from station.results.plane_result import PlaneResult
from station.results.terms import Terms
from station.results.units import Frequency, Pixels, Unit

from .measured import report_of

SLOW_FIXTURES = {"report"}
SVG = "{http://www.w3.org/2000/svg}svg"
HOSTILE = "<script>alert(1)</script><img src=x onerror=alert(1)>\"' {{ 7*7 }} \x1b[2J"


@pytest.fixture(scope="module")
def report(chart_photograph, tmp_path_factory):
    """Of a simulated photograph, both greens, with a limit that one number does not reach."""
    frame = read_frame(chart_photograph(tmp_path_factory.mktemp("report") / "a.dng"), ["G1", "G2"])
    limits = (Limit("mtf50_horizontal", least=0.4), Limit("mtf50_vertical", least=0.9, planes=("G2",)))
    terms = Terms(specification=Specification(limits, "a sharp lens"))
    calibrated = calibrate(frame, Chart.from_seed(), PatternParameters(at=(0.25,)))
    planes = [terms.apply(one, Pixels(2)) for one in calibrated]
    return report_of("pattern", frame, planes, {}, terms)


@pytest.fixture(scope="module")
def page(report):
    return psf_page(report)


def strictly(text):
    """The page as a tree; raises on the first error of its HTML."""
    return html5lib.HTMLParser(strict=True, namespaceHTMLElements=False).parse(text)


def test_both_verdicts_come_first_and_are_not_mixed(page, report):
    assert (report.verdict, report.judged) == ("pass", "does not meet")
    header = strictly(page).find(".//main")[0]
    assert header.get("class") == "verdict pass"
    stated = " ".join("".join(header.itertext()).split())
    assert "Trusted in 2 of 2 planes." in stated
    assert "Does not meet the specification." in stated
    assert "The limit MTF50 along columns ≥ 0.9 cycles/pixel is missed" in stated
    assert "Frequencies in cycles/pixel of the colour plane, whose pixel is 2 of the sensor" in stated


def test_page_shows_every_frequency_in_the_unit_that_was_asked_for(report):
    pixels = Pixels(2, 4.0, 300)
    planes = [one.in_unit(Unit.LINE_PAIRS, pixels) for one in report.planes]
    page = psf_page(replace(report, planes=planes))
    text = " ".join("".join(strictly(page).itertext()).split())
    assert "MTF at 31.25 lp/mm along rows" in text
    assert "Frequencies in lp/mm; ± is one standard uncertainty." in text
    assert Frequency(31.25, Unit.LINE_PAIRS).per_pixel(pixels) == pytest.approx(0.25)


def test_transfer_function_is_drawn_with_phase_in_two_dimensions_and_with_its_limit(page, chart_photograph, tmp_path):
    labels = [svg.get("aria-label") for svg in strictly(page).iter(SVG)]
    assert sum("Phase of the OTF" in label for label in labels) == 2
    assert sum("MTF of the whole PSF over both frequencies" in label for label in labels) == 2
    assert not any("diffraction" in label for label in labels)
    frame = read_frame(chart_photograph(tmp_path / "a.dng"), ["G1"])
    limit = Diffraction(8.0, 8.0, 530.0)
    calibrated = list(calibrate(frame, Chart.from_seed(), PatternParameters(4, 17, chosen=True), lambda plane: limit))
    known = psf_page(report_of("pattern", frame, calibrated, {}))
    assert "diffraction limit at f/8" in known
    assert "up to 1.89 cycles/pixel" in known


def test_page_stands_alone(page):
    drawn = re.sub(r"<script( type=\"application/json\" id=\"[\w-]+\")?>.*?</script>", "", page, flags=re.DOTALL)
    assert not re.search(r"<(script|link|iframe|object)|https?://|@import|url\((?!#)", drawn)
    assert not re.search(r"fetch\(|XMLHttpRequest|WebSocket|import\(", page)
    identifiers = re.findall(r' id="([^"]+)"', page)
    assert len(identifiers) == len(set(identifiers))
    assert len(page.encode()) < 3e6


def test_whatever_is_told_cannot_break_the_page(report):
    record = PlaneResult("G1", Verdict.REFUSED, HOSTILE, HOSTILE)
    hostile = Report(
        HOSTILE,
        "pattern",
        [record],
        [ReportShot(HOSTILE, HOSTILE, HOSTILE, HOSTILE, HOSTILE)],
        {HOSTILE: HOSTILE},
        [ReportLine(HOSTILE, HOSTILE)],
        [ReportLine(HOSTILE, HOSTILE)],
        made=HOSTILE,
    )
    text = psf_page(hostile).replace("\x1b", "")
    tree = strictly(text)
    assert not list(tree.iter("script"))
    assert not list(tree.iter("img"))
    assert "{{ 7*7 }}" in text


def test_refused_plane_has_its_reason_and_remedy_and_no_pictures():
    record = PlaneResult("Y", Verdict.REFUSED, "no chart in the photograph", "show the whole chart")
    stated = Report("a.pgm", "pattern", [record], [], {})
    tree = strictly(psf_page(stated))
    assert stated.headline == "measurement refused, in Y"
    assert "No chart in the photograph. Show the whole chart." in " ".join("".join(tree.itertext()).split())
    assert not list(tree.iter(SVG))


def test_the_bench_its_shots_and_undetermined_frequencies_are_marked(report):
    shots = (*report.shots, ReportShot("b.dng", "0" * 64, note="retaken: the rig moved"))
    stated = replace(report, shots=shots, devices=(ReportLine("stage", "GRBL 1.1h"),), made="2026-01-01 12:00")
    text = psf_page(stated)
    assert all(words in text for words in ("GRBL 1.1h", "retaken: the rig moved", "2026-01-01 12:00"))
    quality = report.planes[0].quality
    assert "not determined" not in str(mtf_figure(quality, None, "clear"))
    rising = np.linspace(0, 0.3, len(quality.frequencies))
    unclear = replace(quality, curve_budgets={**quality.curve_budgets, "horizontal": {"noise": rising}})
    assert "not determined" in str(mtf_figure(unclear, None, "unclear"))


def test_edges_and_physics_stand_beside_the_numbers(report):
    quantity = Quantity(0.3, "cycles/pixel", 0.003, "test", 100)
    edge = SimpleNamespace(
        edge=SimpleNamespace(orientation="near-vertical"), by_edge=quantity, by_psf=quantity, sigmas=0.0
    )
    physics = SimpleNamespace(
        aperture="L-shaped", low_pass="none", missing_corner_deg=45,
        numbers={"wavefront_rms": Quantity(0.05, "wave", 0.002, "test", 100)}, remaining=0.001, chi_square=290.0,
        freedom=280,
    )  # fmt: skip
    record = replace(report.planes[0], edges=(edge,), physics=Outcome(physics, Verdict.DOUBTFUL, "two", "more"))
    page = psf_page(replace(report, planes=[record]))
    text = " ".join("".join(strictly(page).itertext()).split())
    for words in ("MTF50 across the near-vertical edge", "0.3000 ± 0.0030", "its corner missing at 45°", "1.04"):
        assert words in text


def test_figures_show_numbers_under_a_pointer_and_other_results(page, report):
    titles = [one.text for one in strictly(page).iter(SVG.replace("svg}svg", "svg}title"))]
    assert len(titles) == 40 * len(report.planes)
    quality = report.planes[0].quality
    one = next(text for text in titles if text.startswith(f"{quality.frequencies[-1]:.3g} cycles/pixel: horizontal "))
    value, uncertainty = quality.mtf_horizontal[-1], quality.uncertainty("horizontal")[-1]
    assert f"horizontal {value:.3f} ± {uncertainty:.3f}" in one
    record = report.planes[0]
    curves = {"frequency": record.curves["frequency"], "horizontal": record.curves["vertical"]}
    other = Overlay("<last year>", Unit.CYCLES, {record.name: curves})
    others = curves_over([other], record)
    drawn = strictly(f"<!doctype html><title>.</title>{mtf_figure(record.quality, None, 'a', others=others).drawing}")
    assert "<last year>" in "".join(drawn.itertext())
    assert curves_over([other], report.planes[1]) == {}
    with pytest.raises(BadParameter, match="b gives its MTF in lp/mm"):
        curves_over([Overlay("b", Unit.LINE_PAIRS, {record.name: curves})], record)
