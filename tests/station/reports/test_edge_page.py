"""The page and the certificate of slanted edges, on a drawn edge of known MTF50, beside a plane without one."""

from dataclasses import replace
from pathlib import Path

import html5lib
import numpy as np
import pytest
from scipy.special import ndtr

from procedures.quality import Diffraction
from procedures.raw import Exposure, Plane, RawFrame
from station.calibration.edges import PhotographEdges, measure_edges
from station.reports.certificate import certificate_page, number_table
from station.reports.edges.edge_page import edge_page
from station.results.limits import Limit, Specification
from station.results.overlay import Overlay
from station.results.terms import Terms
from station.results.units import Unit

from .measured import report_of

TRUE = 0.25


@pytest.fixture(scope="module")
def frame():
    y, x = np.mgrid[:80, :60]
    d = (x - 29.5 - np.tan(np.radians(5.5)) * (y - 39.5)) * np.cos(np.radians(5.5))
    edge = 0.1 + 0.7 * ndtr(d / (np.sqrt(np.log(2) / 2) / (np.pi * TRUE)))
    planes = {
        "Y": Plane("Y", edge.astype(np.float32), 1 / 65535),
        "B": Plane("B", np.full((80, 60), 0.4, np.float32), 1),
    }
    return RawFrame(Path("<b>.png"), "0" * 64, planes, Exposure())


@pytest.fixture(scope="module")
def stated(frame):
    terms = Terms(specification=Specification((Limit("mtf50", least=0.35),), "sharp"))
    records = list(measure_edges(frame, None, lambda plane: Diffraction(5.6, 4.0, 550), terms))
    curves = {"frequency": np.array([0.0, 0.5]), "mtf": np.array([1.0, 0.1])}
    overlay = Overlay("before", Unit.CYCLES, {"Y": curves})
    report = report_of("edge", frame, [one.result for one in records], {"roi": None}, terms, [overlay])
    edges = PhotographEdges(frame, tuple(records))
    return replace(report, result=edges), edges


def strictly(page):
    return html5lib.HTMLParser(strict=True, namespaceHTMLElements=False).parse(page)


@pytest.mark.slow
def test_page_shows_verdicts_numbers_and_places(frame, stated):
    page = edge_page(stated[0])
    tree = strictly(page)
    text = " ".join(" ".join(tree.itertext()).split())
    (edge,) = stated[1].records[0].edges
    assert abs(edge.numbers["mtf50"].value - TRUE) < 4 * edge.numbers["mtf50"].uncertainty
    assert f"{edge.roi.x}, {edge.roi.y}, {edge.roi.width}, {edge.roi.height}" in text
    assert "Does not meet the specification." in text
    assert "Dashed: before" in text
    assert "roi =" not in text  # a setting that was not made
    assert "diffraction limit at f/5.6" in text
    assert stated[1].records[1].best.reason[1:] in text  # of the plane that shows none
    assert "<b>" not in page
    assert len(page) < 3_000_000


@pytest.mark.slow
def test_figure_shows_the_mtf_where_the_pointer_rests(frame, stated):
    (edge,) = stated[1].records[0].edges
    titles = [one.text for one in strictly(edge_page(stated[0])).iter("{http://www.w3.org/2000/svg}title")]
    assert f"edge 1 {edge.mtf[-1]:.3f} ± {edge.uncertainty[-1]:.3f}" in titles[-1]


def test_certificate_is_of_the_best_edge(stated):
    text = " ".join(" ".join(strictly(certificate_page(stated[0])).itertext()).split())
    number = stated[1].records[0].result.numbers["mtf50"]
    row = next(one for one in number_table(stated[0].planes).rows if one[0].startswith("MTF50 across the edge"))
    assert float(row[1].partition("±")[2]) == pytest.approx(2 * number.uncertainty, rel=0.05)
    assert row[2] == "—"
    assert "ISO 12233" in text
    assert "across each plane's best edge" in text
    assert number_table([]).rows == []
