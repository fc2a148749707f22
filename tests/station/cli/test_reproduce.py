import json

import pytest

from station.demo.reproduce import catalogue, gamma_rows
from station.demo.reproduce.row import ClaimCheck, Order, Row, RowValues
from tests.program import run


def test_a_row_is_computed_and_agrees(tmp_path):
    run("reproduce", "bound-expected", "--out", tmp_path / "out")
    record = json.loads((tmp_path / "out" / "result.json").read_text())
    (row,) = record["rows"]
    assert row["place"] == "Thesis, Proposition 1 and Figure 2.3"
    exactly = 1 - 1 / 289 + 1 / 290 - 1 / (4 * 289)  # both formulas subtracted by hand, N = 289
    assert [check["ours"] for check in row["checks"]] == pytest.approx([exactly] * 2, rel=1e-9)
    assert "<svg" in (tmp_path / "out" / "index.html").read_text(encoding="utf-8")


def test_an_unknown_name_lists_the_rows(tmp_path):
    run("reproduce", "table-9.9", "--out", tmp_path / "out", code=2, says="gamma-table")
    assert not (tmp_path / "out").exists()


def row_above(order=None):
    claim = ClaimCheck("a number", "1", 0.9, 1.1)
    return Row("off", "some", "Thesis", "Off", (claim,), "None.", lambda _: RowValues((2.0,)), order)


def test_a_row_that_is_not_reproduced_returns_one(tmp_path, monkeypatch):
    monkeypatch.setattr(catalogue, "ROWS", (row_above(),))
    done = run("reproduce", "--out", tmp_path, code=1)
    assert "a number: 1; ours 2.000, 0.9 above" in " ".join(done.stdout.split())


def test_a_strict_command_returns_one_for_the_same_direction_alone(tmp_path, monkeypatch):
    monkeypatch.setattr(catalogue, "ROWS", (row_above(Order("It is above 1.", lambda values: values[0] > 1)),))
    run("reproduce", "--out", tmp_path, code=0, says="same direction")
    run("reproduce", "--out", tmp_path, "--strict", code=1)


def test_without_data_rows_are_not_computed(tmp_path, monkeypatch):
    monkeypatch.delenv("STATION_SHARED_DATA", raising=False)
    run("reproduce", "rays-kappa", "--out", tmp_path, code=1, says="not computed")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(["--fetch"], "--fetch needs a folder"), (["--data", "absent"], "--data needs a folder; there is no absent")],
)
def test_a_folder_must_exist_or_be_fetched(tmp_path, monkeypatch, arguments, message):
    monkeypatch.delenv("STATION_SHARED_DATA", raising=False)
    monkeypatch.chdir(tmp_path)
    run("reproduce", "bound-solved", "--out", tmp_path / "out", *arguments, code=2, says=message)


def test_the_tables_bounds_come_from_one_noise_region():
    # Table 2.2 prints 0.10, 0.35, 0.70, 1.15: Proposition 1 for 53 x 54 pixels and what the PSF adds around them
    rows = {check.quantity: check for check in catalogue.ROWS[0].checks}
    assert [rows[f"bound, {r} × {r}"].published for r in gamma_rows.SUPPORTS] == ["0.10", "0.35", "0.70", "1.15"]
    assert gamma_rows.table_window(33) == (61, 62)
