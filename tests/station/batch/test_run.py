"""Batches through the command and its function: what is found, named, kept, resumed, and where it may write."""

import csv
import errno
import hashlib
import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import unquote

import numpy as np
import pytest
from click.exceptions import Exit
from click.testing import CliRunner

from procedures import BadParameter, read_frame
from procedures.outcome import Verdict
from station.__main__ import main
from station.batch.item import ItemRow, Job, _judged, finished, kept_row, work
from station.batch.procedure_file import read_procedure
from station.batch.run import owned, run_batch
from station.batch.stored_rows import _against
from station.calibration.folder_photographs import Item, find_frames, singly
from station.cli.batch import _stopped
from station.results.plane_result import PlaneResult
from tests.program import run

from .test_registry import here

SLOW_FIXTURES = {"done", "interrupted"}
ROOT = Path(__file__).parents[3]
LIMITS = "[limits]\nmtf50_horizontal = { min = 0.4 }\n"
BROKEN = {"truncated": "unreadable", "empty": "unreadable", "text": "unreadable", "dark": "refused"}
GOOD = {"frame0", "frame1", "frame2", "sub/frame0"}


def spoil(folder, chart_photograph):
    whole = chart_photograph(folder / "frame0.dng").read_bytes()
    (folder / "truncated.dng").write_bytes(whole[: len(whole) // 2])
    (folder / "empty.dng").touch()
    (folder / "text.dng").write_text("no photograph")
    chart_photograph(folder / "dark.dng", exposure_s=1e-6)


def test_a_frequency_beyond_the_range_is_named_in_the_row():
    plane = PlaneResult("Y", Verdict.PASS, unavailable=("no MTF at 9 cycles/pixel",))
    assert _judged(ItemRow(["a.dng"], "pass"), [plane]).against == "Y: no MTF at 9 cycles/pixel"


def rows_of(out):
    return [json.loads(line) for line in (out / "results.jsonl").read_text().splitlines()]


@pytest.fixture(scope="module")
def done(tmp_path_factory, chart_photograph):
    """Eight photographs, four of them broken, through the command with two processes."""
    folder = tmp_path_factory.mktemp("batch")
    for seed, name in enumerate(["frame0", "frame1", "frame2", "sub/frame0"]):
        chart_photograph(folder / "in" / f"{name}.dng", seed)
    spoil(folder / "in", chart_photograph)
    (folder / "p.toml").write_text(LIMITS)
    words = [folder / "in", "--procedure", folder / "p.toml", "--out", folder / "out", "--jobs", 2]
    result = CliRunner(env={"COLUMNS": "250"}).invoke(main, ["batch", *map(str, words)], prog_name="station")
    return SimpleNamespace(folder=folder, out=folder / "out", result=result, rows=rows_of(folder / "out"))


def test_table_page_and_results_have_every_photograph_and_broken_ones_are_named(done):
    assert done.result.exit_code == 1, done.result.output
    verdicts = {Path(row["files"][0]).relative_to(done.folder / "in"): row["verdict"] for row in done.rows}
    expected = {Path(f"{name}.dng"): "pass" for name in GOOD} | {Path(f"{n}.dng"): v for n, v in BROKEN.items()}
    assert verdicts == expected
    for row in done.rows:
        assert bool(row["reason"]) == (row["verdict"] != "pass")
        assert bool(row["remedy"]) == (row["verdict"] != "pass")
    assert "4 trusted, 1 refused, 3 unreadable" in " ".join(done.result.stdout.split())
    assert all(f"{name}.dng" in done.result.stdout for name in BROKEN)
    assert "8 of 8, " in done.result.stderr
    assert "left:" in done.result.stderr
    links = {unquote(one) for one in re.findall(r'href="(results/[^"]+)"', (done.out / "report.html").read_text())}
    assert links == {f"{row['folder']}/result.json" for row in done.rows if row["folder"]}
    assert all((done.out / link).is_file() for link in links)
    for row in done.rows:
        folder = done.out / row["folder"]
        record = json.loads((folder / "result.json").read_text())
        assert (record["schema"], record["procedure"]) == ("station/psf/1", "pattern")
        assert record["input"][0]["sha256"] == row["sha256"][0]
        if row["verdict"] == "pass":
            assert np.load(folder / "psf_G1.npy").sum() == pytest.approx(1)
            (limit,) = row["planes"]["G1"]["limits"]
            assert (limit["verdict"], limit["min"], limit["max"]) == ("meets", 0.4, None)
            assert row["specification"] == "meets"


def test_record_shows_the_batch(done):
    files = {".lock", "report.html", "result.json", "results", "results.jsonl", "summary.csv"}
    assert {path.name for path in done.out.iterdir()} == files
    record = json.loads((done.out / "result.json").read_text())
    assert record["schema"] == "station/batch/1"
    assert record["verdicts"] == {"pass": 4, "refused": 1, "unreadable": 3}
    assert record["planes"]["G1"]["mtf50_horizontal"]["n"] == 4
    assert {Path(one["files"][0]).stem for one in record["failed"]} == set(BROKEN)


def again(source, out, text=LIMITS):
    """The rows of photographs, in this process."""
    job = Job(procedure_of(source.parent, text), out, finished(out))
    return [work(item, job) for item in singly(find_frames([source], out))]


def test_optics_that_contradict_a_file_are_named_and_can_be_insisted_on(done, tmp_path):
    (tmp_path / "in").mkdir()
    shutil.copy(done.folder / "in" / "frame0.dng", tmp_path / "in")
    text = "optics = { f_number = 11, pixel_pitch_um = 5 }\n"
    (row,) = again(tmp_path / "in", tmp_path / "out", text)
    assert row.verdict == "refused"
    assert "the f-number was given as 11, but the camera recorded 2.8" in row.reason
    assert row.remedy.endswith("in a procedure file write trust_typed = true")
    (row,) = again(tmp_path / "in", tmp_path / "out", "trust_typed = true\n" + text)
    # it is insisted on, and estimated; the photograph's own far tail shows that it is wrong all the same
    assert row.verdict == "doubtful"
    assert "that of the f-number" in row.reason


def procedure_of(folder, text):
    (folder / "p.toml").write_text(text)
    return read_procedure(folder / "p.toml")


def test_nothing_is_done_twice_even_under_another_name(done, tmp_path):
    out, source = tmp_path / "out", tmp_path / "in"
    shutil.copytree(done.out, out)
    shutil.copytree(done.folder / "in", source)
    (source / "frame1.dng").rename(source / "renamed.dng")
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*")}
    rows = again(source, out)
    assert all(row.reused for row in rows)
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*")} == before
    assert {Path(row.files[0]).name: row.verdict for row in rows}["renamed.dng"] == "pass"
    assert all(str(source) in row.reason for row in rows if row.verdict == "unreadable")


def test_a_full_disk_is_no_verdict_about_the_photograph(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "a.dng").write_text("no photograph")
    monkeypatch.setattr(Path, "write_bytes", full)
    (row,) = again(tmp_path / "in", tmp_path / "out")
    assert (row.verdict, row.folder) == ("lost", "")
    assert row.reason.endswith("cannot be written: No space left on device")


@pytest.mark.parametrize("end", [KeyboardInterrupt(), SystemExit(130)])
def test_a_batch_that_is_ended_names_what_is_kept(tmp_path, capsys, end):
    with pytest.raises(Exit) as exit, _stopped(tmp_path):
        raise end
    assert exit.value.exit_code == 130
    assert "what was done is kept in" in capsys.readouterr().err


@pytest.mark.parametrize("spoil", ["deleted", "emptied", "flipped"])
def test_kept_result_with_a_file_that_is_not_what_was_written_is_not_used(done, tmp_path, spoil):
    spoils = {
        "deleted": lambda path: path.unlink(),
        "emptied": lambda path: path.write_bytes(b""),
        "flipped": lambda path: path.write_bytes(
            path.read_bytes()[:-20] + bytes([path.read_bytes()[-20] ^ 1]) + path.read_bytes()[-19:]
        ),
    }
    row = next(row for row in done.rows if row["verdict"] == "pass")
    names = [path.name for path in (done.out / row["folder"]).iterdir()]
    assert {"result.json", "psf_G1.npy", "numbers.csv", "budget.csv"} <= set(names)
    for name in names:
        shutil.copytree(done.out / row["folder"], tmp_path / name / row["folder"])
        assert kept_row(tmp_path / name, row["folder"])[0].verdict == "pass"
        spoils[spoil](tmp_path / name / row["folder"] / name)
        assert kept_row(tmp_path / name, row["folder"]) == (
            None, f"{name} of the result that was there: missing, or not what was written"
        )  # fmt: skip


@pytest.mark.slow
def test_result_that_was_damaged_is_done_again_and_that_is_said(tmp_path, chart_photograph):
    source, out = chart_photograph(tmp_path / "in" / "one.dng").parent, tmp_path / "out"
    (first,) = again(source, out)
    (out / first.folder / "psf_G1.npy").write_bytes(b"")
    (second,) = again(source, out)
    assert (second.reused, second.folder, second.planes) == (False, first.folder, first.planes)
    assert second.redone.startswith("psf_G1.npy of the result that was there")
    (third,) = again(source, out)
    assert (third.reused, third.redone) == (True, "")


@pytest.mark.slow
def test_photograph_that_is_replaced_while_it_is_worked_on_is_not_kept(tmp_path, chart_photograph, monkeypatch):
    path = chart_photograph(tmp_path / "in" / "one.dng")
    other = chart_photograph(tmp_path / "other.dng", seed=2).read_bytes()

    def replaced(*file):
        path.write_bytes(other)
        return read_frame(*file)

    with monkeypatch.context() as while_read:
        while_read.setattr("station.procedure.base.read_frame", replaced)
        (row,) = again(path.parent, tmp_path / "out")
    assert (row.verdict, row.folder, row.reason) == ("unreadable", "", f"{path} was changed while the batch read it")
    (row,) = again(path.parent, tmp_path / "out")
    assert (row.verdict, row.sha256) == ("pass", [hashlib.sha256(other).hexdigest()])


@pytest.mark.slow
def test_changed_procedure_and_half_written_results_are_done_again(tmp_path, chart_photograph):
    source, out = chart_photograph(tmp_path / "in" / "one.dng").parent, tmp_path / "out"
    (first,) = again(source, out)
    (out / first.folder / "result.json").unlink()
    (torn,) = again(source, out)
    (stricter,) = again(source, out, LIMITS.replace("0.4", "0.9"))
    assert (first.verdict, torn.reused, torn.folder) == ("pass", False, first.folder)
    assert (stricter.verdict, stricter.specification, stricter.reused) == ("pass", "does not meet", False)
    assert stricter.folder != first.folder
    assert "the limit MTF50 along rows ≥ 0.9 cycles/pixel is missed" in stricter.against


@pytest.mark.slow
def test_poison_is_named_and_kept_from_nothing_else(tmp_path, chart_photograph, errands):
    import poison

    for name in ("a", "poison", "z"):
        chart_photograph(tmp_path / "in" / f"{name}.dng")
    items = singly(find_frames([tmp_path / "in"], tmp_path / "out"))
    job = Job(procedure_of(tmp_path, LIMITS), tmp_path / "out")
    batch, _ = run_batch(items, job, function=poison.poisoned)
    assert [row.verdict for row in batch.rows] == ["pass", "lost", "pass"]
    assert "SIGKILL" in batch.rows[1].reason
    assert not batch.rows[1].folder  # nothing is kept of it, so that it is tried again
    assert rows_of(tmp_path / "out")[1]["verdict"] == "lost"


@pytest.mark.parametrize(
    ("verdict", "specification", "usable", "sure"),
    [
        ("pass", "", True, True),
        ("pass", "meets", True, True),
        ("pass", "undecided", True, False),
        ("pass", "does not meet", False, False),
        ("doubtful", "meets", True, False),
        ("refused", "", False, False),
    ],
)
def test_use_of_a_row_follows_from_both_verdicts(verdict, specification, usable, sure):
    row = ItemRow(("a",), verdict, specification=specification)
    assert (row.usable, row.sure) == (usable, sure)


def test_two_batches_in_one_folder_are_refused(tmp_path):
    job = Job(procedure_of(tmp_path, ""), tmp_path / "out")
    with owned(job.out), pytest.raises(BadParameter, match="another batch is writing"):
        run_batch([Item((tmp_path / "a.dng",))], job)


def test_what_killed_workers_leave_is_removed(tmp_path):
    left = tmp_path / "results" / "a-0123456789abcdef" / ".unfinished-x"
    left.mkdir(parents=True)
    with owned(tmp_path):
        assert not left.parent.exists()


HOSTILE = ["<script>alert(1)</script>", "=cmd|'!A0", "line\nbreak", "\x1b[2Jclear", "a...", "'; rm -rf x", "[red]x[/]"]


@pytest.mark.slow
def test_hostile_names_write_nothing_outside_and_break_nothing(tmp_path, chart_photograph, monkeypatch):
    monkeypatch.setattr("station.batch.run._answers", here)
    source, out = tmp_path / "in", tmp_path / "out"
    good = chart_photograph(tmp_path / "good.dng").read_bytes()
    source.mkdir()
    for name in HOSTILE:
        (source / f"{name.replace('/', '_')}.dng").write_bytes(good if name[0] == "<" else b"x")
    (source / os.fsdecode(b"\xff\xfe.dng")).write_bytes(b"x")
    (tmp_path / "p.toml").write_text("")
    words = [source, "--procedure", tmp_path / "p.toml", "--out", out, "--jobs", 1, "--reports"]
    result = run("batch", *words, code=1)
    assert len(rows_of(out)) == len(HOSTILE) + 1
    assert {path.name for path in tmp_path.iterdir()} == {"good.dng", "in", "out", "p.toml"}
    folders = {path.name for path in (out / "results").iterdir()}
    assert all(name.isascii() and name.isprintable() and "/" not in name for name in folders)
    assert "\x1b" not in result.output
    cells = [cell for line in csv.reader(io.StringIO((out / "summary.csv").read_text())) for cell in line]
    assert not [one for one in cells if one.startswith(("=", "@", "+", "\t", "\r"))]
    pages = list(out.rglob("report.html"))
    assert pages
    assert not [page for page in pages if "<script>alert" in page.read_text()]


@pytest.fixture
def interrupted(tmp_path, chart_photograph, start_program, read_until):
    """interrupted(times): a batch of many photographs with one process, and Ctrl-C while it works on them."""
    frame = chart_photograph(tmp_path / "in" / "0.dng")
    for i in range(1, 150):  # different files, one photograph: its last byte is not of the chart
        (tmp_path / "in" / f"{i}.dng").write_bytes(frame.read_bytes()[:-2] + i.to_bytes(2, "little"))
    (tmp_path / "p.toml").write_text(LIMITS)
    words = ["batch", tmp_path / "in", "--procedure", tmp_path / "p.toml", "--out", tmp_path / "out", "--jobs", "1"]

    def run(times):
        command = [sys.executable, "-m", "station", *words]
        process = start_program(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        while not (tmp_path / "out" / "results.jsonl").exists() or not rows_of(tmp_path / "out"):
            assert process.poll() is None
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        read_until(process.stderr, "finishing what runs")
        if times == 2:  # what runs may be finished before it comes
            process.send_signal(signal.SIGINT)
        process.communicate(timeout=180)
        assert process.returncode == 130
        return rows_of(tmp_path / "out")

    return run


@pytest.mark.parametrize("times", [1, 2])
def test_interrupted_batch_keeps_what_is_done(interrupted, tmp_path, times):
    kept = interrupted(times)
    assert 1 <= len(kept) < 150
    assert all(row["verdict"] == "pass" and (tmp_path / "out" / row["folder"] / "result.json").exists() for row in kept)
    if times == 1:
        assert json.loads((tmp_path / "out" / "result.json").read_text())["undone"] == 150 - len(kept)
    job = Job(procedure_of(tmp_path, LIMITS), tmp_path / "out", finished(tmp_path / "out"))
    again = [work(Item((Path(row["files"][0]),)), job) for row in kept]
    assert all(row.reused for row in again)


@pytest.mark.slow
def test_strict_counts_doubt_as_failure_and_json_is_the_record(tmp_path, chart_photograph, monkeypatch):
    monkeypatch.setattr("station.batch.run._answers", here)
    chart_photograph(tmp_path / "in" / "a.dng")
    row = singly([tmp_path / "in" / "a.dng"])[0]
    procedure = procedure_of(tmp_path, "")
    mtf50 = work(row, Job(procedure, tmp_path / "first")).planes["G1"].numbers["mtf50_horizontal"]["value"]
    (tmp_path / "p.toml").write_text(LIMITS.replace("0.4", repr(mtf50)))
    words = ["batch", tmp_path / "in", "--procedure", tmp_path / "p.toml", "--out", tmp_path / "out", "--json"]
    codes = {}
    for more in ((), ("--strict",)):
        done = run(*words, "--log-json", *more, code=None)
        codes[more] = done.exit_code
        record = json.loads(done.stdout)
        assert (record["verdicts"], record["specification_verdicts"]) == ({"pass": 1}, {"undecided": 1})
        events = [json.loads(line) for line in done.stderr.splitlines()]
        assert [one["event"] for one in events] == ["found", "item", "written"]
    assert codes == {(): 0, ("--strict",): 1}


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["in"], "Missing option '--procedure'"),
        (["in", "--procedure", "none.toml"], "none.toml must be a TOML file"),
        (["none", "--procedure", "p.toml"], "there is no folder none"),
        (["in", "--procedure", "p.toml", "--jobs", "0"], "0 is not in the range"),
    ],
)
def test_usage_is_exit_2_and_leaves_nothing(tmp_path, monkeypatch, words, sentence):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in").mkdir()
    (tmp_path / "p.toml").touch()
    done = run("batch", *words, "--out", "out", code=None)
    assert (done.exit_code, Path("out").exists()) == (2, False)
    assert sentence in done.stderr


def test_only_limits_that_are_not_met_are_told():
    limits = [{"verdict": verdict, "words": words} for verdict, words in
              (("meets", "a"), ("undecided", "b"), ("does not meet", "c"))]  # fmt: skip
    assert _against(SimpleNamespace(limits=limits)) == "b; c"
    assert _against(SimpleNamespace(limits=limits[:1])) == ""
