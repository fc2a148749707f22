"""Rows of a batch on the disk, and the summary as CSV and Parquet from them."""

import csv
import dataclasses

import pytest

from station.batch import stored_rows
from station.batch.item import ItemRow, PlaneRow
from station.batch.stored_rows import GROUP_ROWS, StoredRows, Tally, write_csv, write_parquet
from tests.program import run

NUMBER = "mtf50_horizontal"


def row(n, **more):
    number = {"value": 0.3 + n / 1000, "uncertainty": 0.002, "unit": "cycles/pixel", "method": "m", "n": 1}
    planes = {
        "G1": PlaneRow("pass", "", "", {NUMBER: number}, "meets", []),
        "G2": PlaneRow("doubtful", "dim", "", {}, "", []),
    }
    made = ItemRow([f"=frame{n}.dng"], "doubtful", sha256=[f"{n:064x}"], folder=f"results/{n}", planes=planes,
                   noted={"camera": "C", "iso": 100.0})  # fmt: skip
    return dataclasses.replace(made, **more)


@pytest.fixture
def rows(tmp_path):
    stored = StoredRows(tmp_path / "results.jsonl")
    yield stored
    stored.close()


def test_rows_are_read_back_in_the_order_of_the_items_however_they_came(rows, tmp_path):
    for n in (2, 0, 1):
        rows.add(n, row(n))
    assert list(rows) == [row(0), row(1), row(2)]
    assert rows[1:] == (row(1), row(2))
    rows.write_sorted(tmp_path / "sorted")
    (tmp_path / "sorted").replace(tmp_path / "results.jsonl")
    rows.replaced()
    assert list(rows) == [row(0), row(1), row(2)]


def test_a_tally_counts_what_all_rows_say(rows):
    rows.add(0, row(0))
    rows.add(1, ItemRow(["b.dng"], "refused", "dark"))
    rows.add(2, row(2))
    tally = Tally.of(rows)
    assert tally.verdicts == {"doubtful": 2, "refused": 1}
    assert tally.failed == [1]
    assert not tally.all_sure
    expected = {"n": 2, "median": pytest.approx(0.301), "min": 0.3, "max": 0.302}
    assert tally.statistics()["G1"] == {"verdicts": {"pass": 2}, NUMBER: expected}


def test_the_parquet_file_has_the_lines_of_the_csv_file_with_types_and_units(rows, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed (extra `parquet`)")
    for n in range(GROUP_ROWS // 2 + 5):
        rows.add(n, row(n))
    units = Tally.of(rows).units
    write_csv(tmp_path / "t.csv", rows, units)
    write_parquet(tmp_path / "t.parquet", rows, units)
    with (tmp_path / "t.csv").open() as file:
        text = list(csv.DictReader(file))
    table = parquet.read_table(tmp_path / "t.parquet")
    lines = table.to_pylist()
    assert len(lines) == len(text) == 2 * len(rows)
    assert parquet.ParquetFile(tmp_path / "t.parquet").num_row_groups == 2
    assert table.schema.field(NUMBER).metadata == {b"unit": b"cycles/pixel"}
    # a formula is quoted in a spreadsheet's file only
    assert text[0]["files"] == "'=frame0.dng"
    assert lines[0]["files"] == "=frame0.dng"
    for written, typed in zip(text, lines, strict=True):
        shown = "" if typed[NUMBER] is None else f"{typed[NUMBER]:.9g}"
        assert (written[f"{NUMBER} [cycles/pixel]"], written["plane"], written["iso"]) == (
            shown,
            typed["plane"],
            "100.0",
        )
        assert typed["lens"] is None


def test_without_pyarrow_nothing_is_begun(tmp_path, monkeypatch):
    monkeypatch.setattr(stored_rows, "find_spec", lambda name: None)
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "a.pgm").write_bytes(b"P5 2 2 255\n1234")
    (tmp_path / "p.toml").write_text('procedure = "pattern"\n')
    words = ["batch", tmp_path / "in", "--procedure", tmp_path / "p.toml", "--out", tmp_path / "out", "--parquet"]
    done = run(*words, code=2, says="--parquet needs pyarrow")
    assert "calibration-station[parquet]" in done.output
    assert not (tmp_path / "out").exists()


def test_a_batch_writes_the_parquet_file_beside_the_others(tmp_path):
    pytest.importorskip("pyarrow", reason="pyarrow is not installed (extra `parquet`)")
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "a.pgm").write_bytes(b"P5 2 2 255\n1234")
    (tmp_path / "p.toml").write_text('procedure = "pattern"\n')
    words = ["batch", tmp_path / "in", "--procedure", tmp_path / "p.toml", "--out", tmp_path / "out", "--jobs", 1]
    for _ in range(2):  # the second finds its own file there
        run(*words, "--parquet", code=1)
        assert (tmp_path / "out" / "summary.parquet").read_bytes()[:4] == b"PAR1"
