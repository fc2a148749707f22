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


def three():
    """A doubtful item of two planes and two files, one that meets its limits, and a refused one."""
    met, missed = {"words": "it is met", "verdict": "meets"}, {"words": "it is missed", "verdict": "does not meet"}
    number = {"value": 0.3, "uncertainty": 0.002, "unit": "cycles/pixel", "method": "m", "n": 1}
    planes = {
        "G1": PlaneRow("pass", "", "", {NUMBER: number, "gamma": {"value": 0.45}}, "does not meet", [met, missed]),
        "G2": PlaneRow("doubtful", "dim", "light", {NUMBER: {**number, "value": 0.31, "uncertainty": None}}),
    }
    return [
        ItemRow(["=a.dng", "b.dng"], "doubtful", "G2: dim", "light", ["11", "22"], "results/a", planes, reused=True,
                specification="does not meet", noted={"camera": "C", "iso": 100.0, "exposure_s": 0.02}),
        ItemRow(["c.dng"], "pass", planes={"G1": PlaneRow("pass", "", "", {NUMBER: {**number, "value": 0.2}}, "meets")},
                specification="meets", noted={"camera": "C"}),
        ItemRow(["d.dng"], "refused", "dark", "expose longer"),
    ]  # fmt: skip


TABLE = """\
files,verdict,plane,plane_verdict,reason,remedy,specification,against,folder,sha256,camera,lens,captured_at,\
exposure [s],f_number,iso,focal_length [mm],focus_distance [mm],gamma,gamma_uncertainty,\
mtf50_horizontal [cycles/pixel],mtf50_horizontal_uncertainty [cycles/pixel]
'=a.dng + b.dng,doubtful,G1,pass,,,does not meet,it is missed,results/a,11 22,C,,,0.02,,100.0,,,0.45,,0.3,0.002
'=a.dng + b.dng,doubtful,G2,doubtful,dim,light,,,results/a,11 22,C,,,0.02,,100.0,,,,,0.31,
c.dng,pass,G1,pass,,,meets,,,,C,,,,,,,,,,0.2,0.002
d.dng,refused,,,dark,expose longer,,,,,,,,,,,,,,,,
"""


def test_rows_as_a_table_and_a_tally(tmp_path):
    tally = Tally.of(three())
    write_csv(tmp_path / "t.csv", three(), tally.units)
    assert (tmp_path / "t.csv").read_text() == TABLE
    assert (tally.verdicts, tally.specifications) == (
        {"doubtful": 1, "pass": 1, "refused": 1}, {"does not meet": 1, "meets": 1, "": 1},
    )  # fmt: skip
    assert (tally.failed, tally.reused, tally.all_sure) == ([0, 2], 1, False)
    assert tally.units == {NUMBER: "cycles/pixel", "gamma": ""}
    series = {group: (one.unit, [*one.values], [*one.uncertainties]) for group, one in tally.series.items()}
    assert series == {
        ("C", "G1", NUMBER): ("cycles/pixel", [0.3, 0.2], [0.002, 0.002]),
        ("C", "G2", NUMBER): ("cycles/pixel", [0.31], [0.0]),
    }
    assert tally.statistics() == {
        "G1": {"verdicts": {"pass": 2}, NUMBER: {"n": 2, "median": 0.25, "min": 0.2, "max": 0.3}},
        "G2": {"verdicts": {"doubtful": 1}, NUMBER: {"n": 1, "median": 0.31, "min": 0.31, "max": 0.31}},
    }
    assert Tally.of(three()[1:2]).all_sure
    assert [row.usable for row in three()] == [row.sure for row in three()] == [False, True, False]
    assert [row.duration_s for row in three()] == [0.0] * 3


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


def test_a_parquet_file_of_an_earlier_batch_is_written_again_and_agrees_with_the_csv_file(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed (extra `parquet`)")
    (tmp_path / "in").mkdir()
    (tmp_path / "p.toml").write_text('procedure = "pattern"\n')
    out = tmp_path / "out"
    words = ["batch", tmp_path / "in", "--procedure", tmp_path / "p.toml", "--out", out, "--jobs", 1]
    for name, options in (("a", ["--parquet"]), ("b", []), ("c", [])):
        (tmp_path / "in" / f"{name}.pgm").write_bytes(b"P5 2 2 255\n1234")
        run(*words, *options, code=1)
        lines = (out / "summary.csv").read_text().splitlines()
        assert parquet.read_table(out / "summary.parquet").num_rows == len(lines) - 1
