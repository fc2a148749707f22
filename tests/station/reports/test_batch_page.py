"""A batch's page: counts of both verdicts, distributions by camera, every item with its link."""

import html5lib
import pytest

from procedures.outcome import Quantity
from station.reports.batches.batch_page import MAX_LINES, BatchLine, BatchReport, NumberGroup, batch_page

HOSTILE = "<script>alert(1)</script>.dng"
VALUES = [0.31, 0.33, 0.32, 0.31, 0.32, 0.33, 0.9]


def line(number, value, camera="Nikon D750"):
    """An item with one number."""
    measured = {"G1": {"mtf50_horizontal": Quantity(value, "cycles/pixel", 0.004, "", 1)}}
    return BatchLine(f"{number}.dng", "pass", "meets", "", f"results/{number}", camera=camera, planes=measured)


def group_of(values, camera="Nikon D750"):
    return NumberGroup(camera, "G1", "mtf50_horizontal", "cycles/pixel", values, [0.004] * len(values))


REPORT = BatchReport(
    "3 items",
    {"pass": 2, "unreadable": 1},
    {"meets": 1, "does not meet": 1},
    [
        BatchLine("a.dng", "pass", "meets", "", "results/a-1", page=True),
        BatchLine("b.dng", "pass", "does not meet", "the limit MTF50 is missed", "results/b-2"),
        BatchLine(HOSTILE, "unreadable", "", "it is empty", ""),
    ],
    3,
    [group_of([0.31, 0.33]), group_of([0.28], "Canon")],
    {"mtf50_horizontal": [0.3]},
)  # fmt: skip


def read(report):
    return html5lib.HTMLParser(strict=True, namespaceHTMLElements=False).parse(batch_page(report))


def test_the_page_counts_items_and_leads_to_their_results():
    text = " ".join(" ".join(read(REPORT).itertext()).split())
    assert "2 trusted" in text
    assert "1 does not meet" in text
    assert "Nikon D750 G1 MTF50 along rows 2 0.32 0.01414 0.31 0.33 0 cycles/pixel" in text
    assert "Canon G1 MTF50 along rows 1 0.28" in text
    assert "the limit MTF50 is missed" in text
    tree = read(REPORT)
    links = [one.get("href") for one in tree.iter("a")]
    assert links == ["results/a-1/report.html", "results/b-2/result.json", "summary.csv", "results.jsonl"]
    assert HOSTILE not in batch_page(REPORT)
    empty = BatchReport("1 item", {"refused": 1}, {}, [BatchLine("a", "refused", "", "dark", "")], 1)
    assert not list(read(empty).iter("{http://www.w3.org/2000/svg}svg"))


@pytest.fixture(scope="module")
def page_of_seven(tmp_path_factory):
    lines = [line(number, value) for number, value in enumerate(VALUES)]
    path = tmp_path_factory.mktemp("batch") / "report.html"
    path.write_text(batch_page(BatchReport("7 items", {"pass": 7}, {}, lines, 7, [group_of(VALUES)])), encoding="utf-8")
    return path


def test_numbers_have_uncertainties_and_outliers_are_marked(page_of_seven):
    tree = html5lib.parse(page_of_seven.read_text(encoding="utf-8"), namespaceHTMLElements=False)
    marked = ["".join(one.itertext()) for one in tree.iter("strong") if one.get("class") == "outlier"]
    assert marked == ["0.9000 ± 0.0040outlier"]
    assert "0.3100 ± 0.0040" in "".join(tree.itertext())
    # two or three values have no outlier: the median absolute deviation of so few says nothing
    few = BatchReport("2", {"pass": 2}, {}, [line(0, 0.3), line(1, 0.9)], 2, [group_of([0.3, 0.9])])
    assert 'class="outlier"' not in batch_page(few)


@pytest.mark.slow
def test_a_press_on_a_heading_sorts_the_table(page_of_seven, browser):
    browser.open(page_of_seven)
    column = """(() => {
      const table = [...document.querySelectorAll("table.sortable")].at(-1), head = table.tHead.rows[0].cells[4];
      head.querySelector("button").click();
      const values = [...table.tBodies[0].rows].map(one => parseFloat(one.cells[4].textContent));
      return [head.getAttribute("aria-sort"), ...values];
    })()"""
    assert browser.evaluate(column) == ["ascending", *sorted(VALUES)]
    assert browser.evaluate(column) == ["descending", *sorted(VALUES, reverse=True)]


def test_a_page_of_many_photographs_is_as_long_as_one_of_some():
    def page_of(count):
        values = [0.3 + 0.001 * (i % 7) for i in range(count)]
        lines = [line(i % 10, values[i]) for i in range(min(count, MAX_LINES))]
        return batch_page(BatchReport(f"{count} items", {"pass": count}, {}, lines, count, [group_of(values)]))

    some, many = page_of(MAX_LINES), page_of(20 * MAX_LINES)
    assert len(many) < 1.02 * len(some)
