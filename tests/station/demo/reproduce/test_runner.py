from __future__ import annotations

import json
from html.parser import HTMLParser

import pytest
from markupsafe import Markup

from procedures.outcome import BadParameter, Refused
from station.demo.reproduce.catalogue import NOT_HERE, ROWS
from station.demo.reproduce.page import shown
from station.demo.reproduce.reproduction import RowState
from station.demo.reproduce.row import Check, Found, Row, Setting
from station.demo.reproduce.runner import chosen, computed, reproduce


def row(name="one", compute=lambda setting: Found((1.0,)), **more):
    checks = more.pop("checks", (Check.near("a number", "1.02", 0.05),))
    return Row(name, more.pop("chapter", "some"), "Paper, Table 1", "A title", checks, "As told.", compute, **more)


def broken(setting):
    raise ZeroDivisionError("by nothing")


def refused(setting):
    raise Refused("too dark", "more light")


@pytest.mark.parametrize(
    ("check", "ours", "agrees"),
    [
        (Check.near("", "2.0", 0.1), 2.19, True),
        (Check.near("", "2.0", 0.1), 2.21, False),
        (Check.within_factor("", "10", 3), 3.4, True),
        (Check.within_factor("", "10", 3), 31.0, False),
        (Check("", "larger", low=5.0), 5.1, True),
        (Check("", "larger", low=5.0), float("inf"), False),
        (Check("", "smaller", high=5.0), float("nan"), False),
    ],
)
def test_a_number_passes_inside_its_range(check, ours, agrees):
    assert check.agrees(ours) is agrees


def test_a_row_passes_when_all_its_numbers_do():
    checks = (Check("a", "1", 0.9, 1.1), Check("b", "2", 1.9, 2.1))
    assert computed(row(compute=lambda _: Found((1.0, 2.0)), checks=checks), Setting()).state is RowState.PASS
    done = computed(row(compute=lambda _: Found((1.0, 3.0)), checks=checks), Setting())
    assert done.state is RowState.FAIL
    assert [line.passes for line in done.lines] == [True, False]


def test_a_row_without_its_data_is_left_out_with_the_reason(tmp_path):
    needy = row(needs=("photo.pgm",))
    assert computed(needy, Setting()).reason.startswith("the row needs photo.pgm; no data folder")
    done = computed(needy, Setting(tmp_path))
    assert done.state is RowState.LEFT_OUT
    assert f"no photo.pgm in {tmp_path}" in done.reason
    assert "--data" in done.reason
    (tmp_path / "photo.pgm").touch()
    assert computed(needy, Setting(tmp_path)).state is RowState.PASS


def test_a_long_row_waits_for_full_or_for_its_name(tmp_path):
    long = row(long=True)
    assert computed(long, Setting()).state is RowState.LEFT_OUT
    assert computed(long, Setting(full=True)).state is RowState.PASS
    found, _ = reproduce(tmp_path, (long,), Setting(), name="one")
    assert found.agrees


@pytest.mark.parametrize(
    ("compute", "reason"),
    [(broken, "ZeroDivisionError: by nothing"), (refused, "too dark"), (lambda _: Found((1.0, 2.0)), "ValueError")],
)
def test_a_row_that_breaks_fails_and_keeps_the_others(compute, reason, tmp_path):
    found, _ = reproduce(tmp_path, (row("bad", compute), row("good")), Setting())
    assert [one.state for one in found.done] == [RowState.FAIL, RowState.PASS]
    assert reason in found.done[0].reason
    assert not found.agrees


def test_with_the_traceback_asked_for_it_stops(monkeypatch):
    monkeypatch.setenv("STATION_TRACEBACK", "1")
    with pytest.raises(ZeroDivisionError):
        computed(row(compute=broken), Setting())


def test_nothing_computed_is_no_agreement(tmp_path):
    found, _ = reproduce(tmp_path, (row(needs=("absent",)),), Setting())
    assert not found.agrees


def test_rows_are_chosen_by_name_or_chapter_and_told_when_there_is_none():
    rows = (row("a", chapter="x"), row("b", chapter="x"), row("c", chapter="y"))
    assert [one.name for one in chosen(rows, "x")] == ["a", "b"]
    assert [one.name for one in chosen(rows, "c")] == ["c"]
    assert len(chosen(rows, None)) == 3
    with pytest.raises(BadParameter, match=r"name a row \(a, b, c\) or a chapter \(x, y\)"):
        chosen(rows, "z")


class Text(HTMLParser):
    """The words of a page, and the places that its links name."""

    def __init__(self):
        super().__init__()
        self.words, self.ids, self.links = [], set(), set()

    def handle_starttag(self, tag, attributes):
        told = dict(attributes)
        self.ids.add(told.get("id"))
        if tag == "a":
            self.links.add(told["href"][1:])

    def handle_data(self, data):
        self.words.append(data)


def test_page_and_record_tell_every_row(tmp_path):
    figure = Markup('<svg role="img" aria-label="drawn"></svg>')
    rows = (
        row("drawn", lambda _: Found((1.0,), (figure,), "A <remark>.")),
        row("off", lambda _: Found((2e-7,))),
        row("absent", needs=("photo.pgm",)),
    )
    told = []
    reproduce(tmp_path, rows, Setting(), progress=lambda done, steps=1: told.append(done))
    assert [sentence.split(" (")[0].split(": the")[0] for sentence in told] == [
        "drawn: pass", "off: fail", "absent: left out"
    ]  # fmt: skip

    html = (tmp_path / "index.html").read_text(encoding="utf-8")
    page = Text()
    page.feed(html)
    words = " ".join(" ".join(page.words).split())
    assert "1 of 2 rows pass, 1 left out" in words
    assert str(figure) in html
    assert "A <remark>." in words
    assert "2.00×10^−7" in words
    assert "no data folder" in words
    assert {"drawn", "off", "absent"} <= page.links <= page.ids
    assert all(place in words for place, _ in NOT_HERE)

    record = json.loads((tmp_path / "result.json").read_text())
    assert record["summary"] == {"pass": 1, "fail": 1, "left_out": 1}
    checks = record["rows"][0]["checks"]
    assert checks == [
        {
            "quantity": "a number", "unit": "", "published": "1.02", "ours": 1.0,
            "low": pytest.approx(0.969), "high": pytest.approx(1.071), "pass": True,
        }
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("value", "words"),
    [(0.19604, "0.1960"), (31806.2, "31806"), (2.1e12, "2.10×10^12"), (-0.05, "−0.05000"), (0.0, "0.000")],
)
def test_numbers_are_shown_to_four_digits(value, words):
    assert shown(value) == words


def test_every_row_has_its_own_name_and_says_where_it_was_published():
    names = [row.name for row in ROWS]
    assert len(set(names)) == len(names)
    assert not set(names) & {row.chapter for row in ROWS}
    for row in ROWS:
        assert row.place.startswith(("Thesis", "IPOL", "Sorel"))
        assert row.checks
        assert all(check.low <= check.high and check.published for check in row.checks)
