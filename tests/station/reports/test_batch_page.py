"""A batch's page: counts of both verdicts, distributions by camera, every item with its link."""

from __future__ import annotations

import html5lib

from station.reports.batches.batch_page import MAX_STROKES, BatchLine, BatchReport, NumberGroup, batch_page

HOSTILE = "<script>alert(1)</script>.dng"
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
    [NumberGroup(camera, "G1", "mtf50_horizontal", "cycles/pixel", values) for camera, values in
     (("Nikon D750", [0.31, 0.33]), ("Canon", [0.28]))],
    {"mtf50_horizontal": [0.3]},
)  # fmt: skip


def read(report):
    return html5lib.HTMLParser(strict=True, namespaceHTMLElements=False).parse(batch_page(report))


def test_counts_distributions_and_reasons_are_told():
    text = " ".join(" ".join(read(REPORT).itertext()).split())
    assert "2 trusted" in text
    assert "1 does not meet" in text
    assert "Nikon D750 G1 MTF50 along rows 2 0.32 0.31 0.33 cycles/pixel" in text
    assert "Canon G1 MTF50 along rows 1 0.28" in text
    assert "the limit MTF50 is missed" in text


def test_items_lead_to_their_results_and_hold_no_markup():
    tree = read(REPORT)
    links = [one.get("href") for one in tree.iter("a")]
    assert links == ["results/a-1/report.html", "results/b-2/result.json", "summary.csv", "results.jsonl"]
    assert not list(tree.iter("script"))


def test_batch_of_nothing_but_refusals_has_a_page_without_pictures():
    empty = BatchReport("1 item", {"refused": 1}, {}, [BatchLine("a", "refused", "", "dark", "")], 1)
    assert not list(read(empty).iter("{http://www.w3.org/2000/svg}svg"))


def test_a_page_of_many_photographs_is_as_long_as_one_of_some():
    def page_of(count):
        values = [0.3 + 0.001 * (i % 7) for i in range(count)]
        group = NumberGroup("Canon", "G1", "mtf50_horizontal", "cycles/pixel", values)
        return batch_page(BatchReport(f"{count} items", {"pass": count}, {}, REPORT.lines, count, [group]))

    some, many = page_of(MAX_STROKES), page_of(100 * MAX_STROKES)
    assert len(many) < 1.02 * len(some)
    assert f"{MAX_STROKES} quantiles" in many
