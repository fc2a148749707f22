import json
from html.parser import HTMLParser

import pytest
from markupsafe import Markup

from procedures.outcome import BadParameter, Refused
from station.demo.reproduce.catalogue import NOT_HERE, ROWS
from station.demo.reproduce.row import ClaimCheck, Row, RowValues, Setting, increases, read_check, read_row, shown
from station.demo.reproduce.runner import RowState, compute, reproduce, select


def printed(quantity, published, unit="", read="printed"):
    return read_check({"quantity": quantity, "published": published, "unit": unit, "read": read})


def row(name="one", values=lambda setting: RowValues((1.0,)), **more):
    checks = more.pop("checks", (printed("a number", "1.0"),))
    return Row(name, more.pop("chapter", "some"), "Paper, Table 1", "A title", checks, "Simulated.", values, **more)


def broken(setting):
    raise ZeroDivisionError("by nothing")


def refused(setting):
    raise Refused("too dark", "more light")


@pytest.mark.parametrize(
    ("check", "ours", "deviation"),
    [
        (printed("", "2.0"), 2.04, ""),
        (printed("", "2.0", "px"), 2.1, "0.05 px above, 1.02 times"),
        (printed("", "10"), 9.4, "0.1 below, 0.989 times"),
        (printed("", "0.25", read="at most"), 0.0, ""),
        (printed("", "0.25", read="at most"), 0.51, "0.255 above, 2 times"),
        (printed("", "3", read="at least"), 2.4, "0.1 below, 0.96 times"),
        (ClaimCheck("", "positive", 0.0), -2.0, "2 below"),
        (ClaimCheck("", "larger", low=5.0), float("inf"), "not finite"),
        (ClaimCheck("", "smaller", high=5.0), float("nan"), "not finite"),
    ],
)
def test_a_value_agrees_within_the_papers_claim_and_else_states_its_distance(check, ours, deviation):
    assert check.agrees(ours) is (not deviation)
    assert check.deviation(ours) == deviation


@pytest.mark.parametrize(
    ("values", "state"),
    [
        ((1.0, 2.0), RowState.REPRODUCED),
        ((1.0, 3.0), RowState.SAME_DIRECTION),
        ((2.0, 1.0), RowState.NOT_REPRODUCED),
        ((1.0, float("nan")), RowState.NOT_REPRODUCED),
    ],
)
def test_a_row_has_three_states(values, state, tmp_path):
    checks = (printed("a", "1"), printed("b", "2"))
    result, _ = reproduce(
        tmp_path,
        (row(values=lambda _: RowValues(values), checks=checks, order=increases("it grows", (0, 2))),),
        Setting(),
    )
    assert result.rows[0].state is state
    assert result.agrees is (state is not RowState.NOT_REPRODUCED)


def test_values_that_differ_without_an_order_are_not_reproduced():
    assert compute(row(values=lambda _: RowValues((1.2,))), Setting()).state is RowState.NOT_REPRODUCED


def test_a_row_without_its_data_is_not_computed_for_a_reason(tmp_path):
    needy = row(needs=("photo.pgm",))
    assert compute(needy, Setting()).reason.startswith("the row needs photo.pgm; no data folder")
    done = compute(needy, Setting(tmp_path))
    assert done.state is RowState.NOT_COMPUTED
    assert f"no photo.pgm in {tmp_path}" in done.reason
    assert "--data" in done.reason
    (tmp_path / "photo.pgm").touch()
    assert compute(needy, Setting(tmp_path)).state is RowState.REPRODUCED


def test_a_long_row_waits_for_full_or_for_its_name(tmp_path):
    long = row(long=True)
    assert compute(long, Setting()).state is RowState.NOT_COMPUTED
    assert compute(long, Setting(full=True)).state is RowState.REPRODUCED
    result, _ = reproduce(tmp_path, (long,), Setting(), name="one")
    assert result.agrees


@pytest.mark.parametrize(
    ("values", "reason"),
    [(broken, "ZeroDivisionError: by nothing"), (refused, "too dark"), (lambda _: RowValues((1.0, 2.0)), "ValueError")],
)
def test_a_row_that_breaks_fails_and_keeps_the_others(values, reason, tmp_path):
    result, _ = reproduce(tmp_path, (row("bad", values), row("good")), Setting())
    assert [one.state for one in result.rows] == [RowState.NOT_REPRODUCED, RowState.REPRODUCED]
    assert reason in result.rows[0].reason
    assert not result.agrees


def test_with_the_traceback_asked_for_it_stops(monkeypatch):
    monkeypatch.setenv("STATION_TRACEBACK", "1")
    with pytest.raises(ZeroDivisionError):
        compute(row(values=broken), Setting())


def test_nothing_computed_is_no_agreement(tmp_path):
    result, _ = reproduce(tmp_path, (row(needs=("absent",)),), Setting())
    assert not result.agrees


def test_rows_are_selected_by_name_or_chapter_and_listed_for_an_unknown_name():
    rows = (row("a", chapter="x"), row("b", chapter="x"), row("c", chapter="y"))
    assert [one.name for one in select(rows, "x")] == ["a", "b"]
    assert [one.name for one in select(rows, "c")] == ["c"]
    assert len(select(rows, None)) == 3
    with pytest.raises(BadParameter, match=r"name a row \(a, b, c\) or a chapter \(x, y\)"):
        select(rows, "z")


class Text(HTMLParser):
    """Words, ids and link targets of a page."""

    def __init__(self):
        super().__init__()
        self.words, self.ids, self.links = [], set(), set()

    def handle_starttag(self, tag, attributes):
        named = dict(attributes)
        self.ids.add(named.get("id"))
        if tag == "a":
            self.links.add(named["href"][1:])

    def handle_data(self, data):
        self.words.append(data)


def test_page_and_record_contain_every_row(tmp_path):
    figure = Markup('<svg role="img" aria-label="drawn"></svg>')
    rows = (
        row("drawn", lambda _: RowValues((1.0,), (figure,), "A <remark>.")),
        row("off", lambda _: RowValues((2e-7,))),
        row("absent", needs=("photo.pgm",)),
    )
    sentences = []
    reproduce(tmp_path, rows, Setting(), progress=lambda done, steps=1: sentences.append(done))
    assert [sentence.split(" (")[0].split(": the")[0] for sentence in sentences] == [
        "drawn: reproduced", "off: not reproduced", "absent: not computed"
    ]  # fmt: skip

    html = (tmp_path / "index.html").read_text(encoding="utf-8")
    page = Text()
    page.feed(html)
    words = " ".join(" ".join(page.words).split())
    assert "1 reproduced, 1 not reproduced, 1 not computed" in words
    assert str(figure) in html
    assert "A <remark>." in words
    assert "2.00×10^−7" in words
    assert "no data folder" in words
    assert {"drawn", "off", "absent"} <= page.links <= page.ids
    assert all(place in words for place, _ in NOT_HERE)

    record = json.loads((tmp_path / "result.json").read_text())
    assert record["summary"] == {"reproduced": 1, "same_direction": 0, "not_reproduced": 1, "not_computed": 1}
    checks = [check for one in record["rows"] for check in one["checks"]]
    assert checks[0] == {
        "quantity": "a number", "unit": "", "published": "1.0", "ours": 1.0, "low": pytest.approx(0.95),
        "high": pytest.approx(1.05), "agrees": True, "deviation": "",
    }  # fmt: skip
    assert (checks[1]["agrees"], checks[1]["deviation"]) == (False, "0.95 below, 2.11e-07 times")


@pytest.mark.parametrize(
    ("value", "words"),
    [(0.19604, "0.1960"), (31806.2, "31806"), (2.1e12, "2.10×10^12"), (-0.05, "−0.05000"), (0.0, "0.000")],
)
def test_numbers_are_shown_to_four_digits(value, words):
    assert shown(value) == words


def test_published_numbers_are_checks_of_rows_with_names_and_places():
    table = {
        "module": "gamma_rows", "chapter": "gamma", "place": "Thesis", "setup": "None.", "each": ["dark", "bright"],
        "checks": [{"quantity": "error", "published": ["0.25", "0.5"], "read": "at most", "unit": "pixels"}],
    }  # fmt: skip
    checks = read_row("bound-solved", table).checks
    assert [(one.quantity, one.published, one.high) for one in checks] == [
        ("error, dark", "0.25", 0.255), ("error, bright", "0.5", 0.55)
    ]  # fmt: skip
    names = [row.name for row in ROWS]
    assert len(set(names)) == len(names)
    assert not set(names) & {row.chapter for row in ROWS}
    for row in ROWS:
        assert row.place.startswith(("Thesis", "IPOL", "Sorel"))
        assert row.checks
        assert all(check.low <= check.high and check.published for check in row.checks)


DIRECTION_ONLY = {
    "gamma-table", "simulated-rivals", "joshi-photograph", "rays-cornell", "rays-scales", "rays-samples", "rays-bins",
    "rays-oracle", "rays-bias", "restoration-known", "restoration-40db", "restoration-defocus", "restoration-start",
    "restoration-gaussian", "restoration-direct", "restoration-chain", "restoration-chain-motion", "restoration-sigma",
}  # fmt: skip
"""Rows whose order holds and whose values differ from the papers'; all others are within the papers' claims."""
OF_SECONDS = {
    "restoration-known", "restoration-40db", "restoration-start", "stability", "simulated-rivals", "rays-kappa",
    "rays-oracle", "restoration-gaussian", "restoration-direct", "accuracy", "gamma-table", "bound-realised",
    "two-photo-zoom-published", "two-photo-zoom", "two-photo-simulated", "rays-cornell", "apertures",
    "restoration-sigma", "gamma-patterns", "gamma-support", "rays-bias", "supports", "places", "wall-chart",
    "comparison", "rays-scales", "planes",
}  # fmt: skip
"""Rows of the quick set that take a second of processor and more: nightly, but for one of each chapter."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "one",
    [
        pytest.param(one, id=one.name, marks=pytest.mark.nightly if one.long or one.name in OF_SECONDS else ())
        for one in ROWS
    ],
)
def test_rows_keep_their_states(one, shared_data):
    result = compute(one, Setting(shared_data, threads=2), by_name=True)
    expected = RowState.SAME_DIRECTION if one.name in DIRECTION_ONLY else RowState.REPRODUCED
    assert result.state is expected, [(check.quantity, value) for check, value in result.deviating] or result.reason
