"""The part of a page that a script makes, in a browser: places, units, other results, limits."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from procedures.numbers import OF_PLACES
from procedures.outcome import Quantity, Verdict
from station.common.sanitise import stated
from station.reports.explore import ExploredPlace, ExploredPlaces
from station.reports.report import Report
from station.reports.report_page import report_page
from station.results.overlay import Overlay
from station.results.plane_result import PlaneResult
from station.results.units import Unit

SLOW_FIXTURES = {"opened"}

HOSTILE = "</script><script>alert(1)</script>"
F = np.linspace(0, 1, 11)
MTF50 = Quantity(0.31234, "cycles/pixel", 0.0042, "", 1)
PITCH_UM, PITCH = 4.0, 2
LP_MM = 1000 / (PITCH * PITCH_UM)
PLACES = ((10.0, 10.0), (30.0, 10.0))


def curves(width):
    return {"frequency": F, "horizontal": np.exp(-F / width), "horizontal_uncertainty": 0.01 * F}


def spot(number, x, y):
    numbers = {name: Quantity(0.2 + 0.1 * number, "cycles/pixel", 0.003, "", 1) for name in OF_PLACES}
    budgets = {name: {"noise": 0.002, "interpolation": 0.0022} for name in OF_PLACES}
    samples = np.ones((3, 3)) + number * np.eye(3)
    return ExploredPlace(x, y, True, numbers, budgets, curves(0.3 + 0.1 * number), samples, 4)


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    plane = PlaneResult("G1", Verdict.PASS, numbers={"mtf50_horizontal": MTF50}, curves=curves(0.5), pitch=PITCH)
    other = Overlay("lens B", Unit.CYCLES, {"G1": curves(0.9)})
    report = Report(HOSTILE, "field", [plane], [], {"pixel_pitch_um": PITCH_UM}, overlays=[other])
    spots = {"G1": ExploredPlaces((20, 40), [spot(number, *place) for number, place in enumerate(PLACES)])}
    path = tmp_path_factory.mktemp("explore") / "report.html"
    path.write_text(report_page(report, spots=spots), encoding="utf-8")
    return path


@pytest.fixture
def opened(page, browser):
    browser.shown(1440, 900)
    browser.open(page)
    return browser


def choose(browser, words, value):
    """Choose a value of the control that is labelled with words."""
    script = """((words, value) => {
      const labels = [...document.querySelectorAll("#explore label")];
      const label = labels.find(one => one.textContent.trim().startsWith(words));
      const control = label.querySelector("select, input");
      control.value = value;
      control.dispatchEvent(new Event("input"));
    })"""
    browser.evaluate(f"{script}({json.dumps(words)}, {json.dumps(value)})")


def text(browser, selector):
    return browser.evaluate(f"document.querySelector({json.dumps(selector)}).textContent")


def test_data_cannot_end_their_script(page):
    assert HOSTILE not in page.read_text(encoding="utf-8")
    plain = PlaneResult("G1", Verdict.REFUSED, "no chart", "show it")
    assert "explore-data" not in report_page(Report("a", "pattern", [plain], [], {}))


def test_a_place_under_the_pointer_has_its_psf_its_mtf_and_its_budget(opened):
    at = "document.querySelectorAll('.frame rect')[1].dispatchEvent(new Event('pointerenter'))"
    opened.evaluate(at)
    assert "x 30, y 10" in text(opened, ".psf figcaption")
    assert opened.evaluate("document.querySelector('.psf canvas').width") == 3
    assert stated(0.3, 0.003) in text(opened, "#explore table")
    assert "interpolation 0.0022, noise of the samples 0.002" in text(opened, "#explore table")
    # the script interpolates between the points of the curve
    value, own = np.interp(0.25, F, np.exp(-F / 0.4)), np.interp(0.25, F, 0.01 * F)
    assert stated(value, own) in text(opened, ".mtf figcaption")
    assert stated(np.interp(0.25, F, np.exp(-F / 0.9)), own) in text(opened, ".mtf figcaption")  # of the other result


def test_units_of_the_page_and_of_the_plot_are_switched_together(opened):
    choose(opened, "Unit", "lp/mm")
    words = stated(LP_MM * MTF50.value, LP_MM * MTF50.uncertainty)
    assert text(opened, ".facts dd") == words
    assert text(opened, ".facts dt").endswith("lp/mm")
    assert "frequency, lp/mm" in text(opened, ".mtf svg")
    choose(opened, "Unit", "cycles/pixel")
    assert text(opened, ".facts dd") == stated(MTF50.value, MTF50.uncertainty)


@pytest.mark.parametrize(("limit", "verdict"), [(0.30, "meets"), (0.31, "undecided"), (0.325, "does not meet")])
def test_a_limit_has_its_probability_of_conformity(opened, limit, verdict):
    choose(opened, "Limit", "at least")
    opened.evaluate(f"""(() => {{
      const box = document.querySelector("input[aria-label=Limit]");
      box.value = {limit};
      box.dispatchEvent(new Event("input"));
    }})()""")
    words = text(opened, ".limit figcaption")
    probability = 100 * norm.cdf((MTF50.value - limit) / MTF50.uncertainty)
    assert float(re.search(r"conformity: (?:above )?([\d.]+) %", words)[1]) == pytest.approx(probability, abs=0.1)
    assert f"uncertainties: {verdict}." in words


FILES = {
    "mtf_G1.csv": "frequency [lp/mm],horizontal,horizontal_uncertainty\n0,1,0\n125,0,0\n",
    "result.json": json.dumps(
        {"input": [{"path": "a/lens C.dng"}], "planes": {"G1": {"mtf50_horizontal": vars(MTF50)}}}
    ),
}


def test_other_results_are_drawn_over_it(opened, page):
    files = {**FILES, "other.html": page.read_text(encoding="utf-8")}
    shown = opened.evaluate(f"""(async () => {{
      const files = new DataTransfer(), box = document.querySelector("#explore input[type=file]");
      for (const [name, text] of Object.entries({json.dumps(files)})) files.items.add(new File([text], name));
      box.files = files.files;
      box.dispatchEvent(new Event("input"));
      const read = () => document.querySelectorAll(".mtf figcaption div").length === 5;
      while (!read()) await new Promise(done => setTimeout(done, 5));
      return document.querySelector(".mtf figcaption").innerText;
    }})()""")
    assert "mtf_G1.csv along rows: 0.75" in shown  # 1 - 0.25 * 125 / 125 lp/mm: 125 are 1 cycle per pixel
    assert "lens C.dng: numbers of its record" in shown
    assert shown.count(stated(np.interp(0.25, F, np.exp(-F / 0.5)), 0.0025)) == 2  # its own, and that of its page


def test_a_page_in_other_units_holds_the_same_data(page):
    plane = PlaneResult("G1", Verdict.PASS, numbers={"mtf50_horizontal": MTF50}, curves=curves(0.5), pitch=PITCH)
    in_lp = replace(plane, unit=Unit.LINE_PAIRS, factor=LP_MM, curves={**curves(0.5), "frequency": LP_MM * F})
    number = replace(MTF50, value=LP_MM * MTF50.value, uncertainty=LP_MM * MTF50.uncertainty, unit="lp/mm")

    def data(one):
        text = report_page(Report("a", "field", [one], [], {}))
        return json.loads(re.search(r'id="explore-data">(.*?)</script>', text)[1])["planes"][0]

    one, other = data(plane), data(replace(in_lp, numbers={"mtf50_horizontal": number}))
    assert one["curves"] == other["curves"]
    assert one["numbers"][0]["value"] == pytest.approx(other["numbers"][0]["value"], rel=1e-6)
