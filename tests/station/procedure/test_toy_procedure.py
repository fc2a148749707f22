"""A procedure of a package outside: one file of at most 60 lines gets every ability."""

import json
from functools import partial
from pathlib import Path

import cv2
import jsonschema
import numpy as np
import pytest

from procedures.raw import read_frame
from station.procedure.schema import added
from tests.program import run

pytestmark = pytest.mark.slow
PACKAGE = Path(__file__).with_name("toy_package")


@pytest.fixture(scope="module")
def station(tmp_path_factory):
    """The program beside the installed package, in a fresh folder with two photographs."""
    folder = tmp_path_factory.mktemp("toy")
    (folder / "shoot").mkdir()
    for name, level in (("bright", 0.5), ("dark", 0.02)):
        noise = 0.001 * np.random.default_rng(1).standard_normal((40, 60))
        samples = np.rint(65535 * (level + noise)).clip(0, 65535).astype(np.uint16)
        cv2.imwrite(str(folder / "shoot" / f"{name}.png"), samples)
    (folder / "limits.toml").write_text("[limits]\nmean_level = { min = 0.6 }\n")
    (folder / "batch.toml").write_text(
        'procedure = "mean-level"\n[limits]\nmean_level = { min = 0.3 }\n[settings]\nborder_px = 2\n'
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(PACKAGE))
        patch.chdir(folder)
        added.cache_clear()
        command = partial(run, code=None)
        command.folder = folder
        yield command
    added.cache_clear()


def test_it_is_one_short_file():
    assert len((PACKAGE / "mean_level.py").read_text().splitlines()) <= 60


def test_a_command_has_options_record_page_limits_and_errors(station):
    assert "mean-level" in station("--help").stdout
    shown = station("mean-level", "--help").stdout
    assert "Measure the mean level of IMAGE" in shown
    assert "--border-px" in shown
    assert "0<=x<=100" in shown
    done = station("mean-level", "shoot/bright.png", "--out", "one", "--certificate")
    assert done.exit_code == 0, done.stderr
    assert "Y: trusted; Mean level 0.49999" in done.stderr
    record = json.loads((station.folder / "one" / "result.json").read_text())
    assert record["schema"] == "station/mean-level/1"
    assert record["parameters"]["border_px"] == 4
    assert record["planes"]["Y"]["mean_level"]["value"] == pytest.approx(0.5, abs=1e-4)
    page = (station.folder / "one" / "report.html").read_text()
    assert "Mean level" in page
    assert "<svg" in page  # its curve
    assert "Mean level" in (station.folder / "one" / "certificate.html").read_text()
    missed = station("mean-level", "shoot/bright.png", "--out", "two", "--specification", "limits.toml")
    assert missed.exit_code == 1
    assert "Mean level ≥ 0.6 is missed" in missed.stderr
    doubtful = station("mean-level", "shoot/dark.png", "--out", "three")
    assert doubtful.exit_code == 0
    assert "the mean level is 0.02" in doubtful.stderr
    assert "expose longer" in doubtful.stderr
    done = station("mean-level", "shoot/dark.png", "--out", "four", "--border-px", "200")
    assert done.exit_code == 2
    assert "--border-px" in done.stderr


def test_a_batch_runs_it_and_its_records_follow_the_schema(station):
    done = station("batch", "shoot", "--procedure", "batch.toml", "--out", "all", "--jobs", 1)
    assert done.exit_code == 1, done.stderr  # the dark one misses its limit
    rows = [json.loads(line) for line in (station.folder / "all" / "results.jsonl").read_text().splitlines()]
    assert [(Path(row["files"][0]).stem, row["verdict"], row["specification"]) for row in rows] == [
        ("bright", "pass", "meets"), ("dark", "doubtful", "does not meet"),
    ]  # fmt: skip
    record = json.loads((station.folder / "all" / rows[0]["folder"] / "result.json").read_text())
    assert record["parameters"]["border_px"] == 2
    assert "mean_level" in (station.folder / "all" / "summary.csv").read_text()
    assert station("manual", "--schemas", "schemas").exit_code == 0
    schema = json.loads((station.folder / "schemas" / "mean-level.schema.json").read_text())
    jsonschema.validate(record, schema, jsonschema.Draft202012Validator)
    batch = json.loads((station.folder / "all" / "result.json").read_text())
    schema_of_batch = json.loads((station.folder / "schemas" / "batch.schema.json").read_text())
    jsonschema.validate(batch, schema_of_batch, jsonschema.Draft202012Validator)
    record["planes"]["Y"]["verdict"] = "good"
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(record, schema)


@pytest.fixture(scope="module")
def guided(station):
    """The session of a guided run on the simulated bench, in which only Enter is pressed, with what was shown."""
    bench = ("--plain", "--simulate", "--sessions", "sessions")
    done = station(*bench, "--specification", "limits.toml", "--plan", "mean-level", typed="\n" * 40)
    (session,) = (station.folder / "sessions").iterdir()
    return session, done


def test_a_guided_run_needs_only_enter_and_leaves_a_whole_session(guided, station):
    session, done = guided
    assert done.exit_code == 1, done.stderr  # the chart is darker than the limit
    assert ">> Border px: Pixels of the rim that are excluded. [4]" in done.stdout
    record = json.loads((session / "derived" / "1" / "result.json").read_text())
    level = record["planes"]["G1"]["mean_level"]
    assert f"G1 trusted: Mean level {level['value']:.4f}" in done.stdout
    assert record["procedure"] == "mean-level"
    assert record["parameters"] == {"border_px": 4}
    (photograph,) = (one["path"] for one in record["input"])
    plane = read_frame(session / photograph, ["G1"]).planes["G1"].samples
    assert level["value"] == pytest.approx(float(plane[4:-4, 4:-4].mean()), rel=1e-6)  # both in float32
    assert "Mean level" in (session / "derived" / "1" / "report.html").read_text()
    assert "Mean level" in (session / "certificate.html").read_text()
    recomputed = station("session", "recompute", session)
    assert recomputed.exit_code == 0, recomputed.stderr
    assert "identical, 3 files" in recomputed.stderr


def test_an_unknown_plan_is_answered_by_all_that_exist(station):
    done = station("--plain", "--simulate", "--plan", "mean-levle", typed="")
    assert done.exit_code == 2
    assert "pattern" in done.stderr
    assert "mean-level" in done.stderr
