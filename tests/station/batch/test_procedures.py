"""Batches of the procedures of `station.procedure`, on the inputs of the golden records: one item fails, others do not.

The record of every item, of those that failed too, follows the schema that is generated from the procedure.
"""

import json
import shutil
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from station.procedure.schema import procedure_named, schema_of
from tests.golden import cases
from tests.program import run

from .test_registry import here

pytestmark = pytest.mark.slow


def by_name(out: Path) -> dict[str, dict]:
    """The rows of a batch by what their item is called: the folder of its first file, and its name."""
    rows = [json.loads(line) for line in (out / "results.jsonl").read_text(encoding="utf-8").splitlines()]
    return {"/".join(Path(row["files"][0]).parts[-2:]): row for row in rows}


def record_of(out: Path, row: dict, name: str) -> dict:
    """The record of an item, which follows its schema."""
    record = json.loads((out / row["folder"] / "result.json").read_text(encoding="utf-8"))
    jsonschema.validate(record, schema_of(procedure_named(name)), jsonschema.Draft202012Validator)
    return record


@pytest.fixture
def batch(tmp_path, monkeypatch):
    """batch(name, text, *folders): the rows of a batch by name, and its folder; in this process."""
    monkeypatch.setattr("station.batch.run._answers", here)

    def batch(name: str, text: str, *folders: Path, code: int = 1, options: tuple[str, ...] = ()):

        (tmp_path / "p.toml").write_text(f'procedure = "{name}"\n{text}')
        out = tmp_path / "results"
        words = ("batch", *folders, "--procedure", tmp_path / "p.toml", "--out", out, "--jobs", 1, *options)
        run(*words, code=code)
        return by_name(out), out

    return batch


def test_sensors_of_each_folder(batch, tmp_path):
    """The manifest is of the item: it lies above all pictures, and another one is another measurement."""
    cases.sensor(tmp_path)
    (tmp_path / "dark_only").mkdir()
    shutil.copy(tmp_path / "shoot" / "dark" / "short0.dng", tmp_path / "dark_only" / "short0.dng")
    (tmp_path / "shoot" / "dark").rename(tmp_path / "shoot" / "light" / "dark")
    (tmp_path / "shoot" / "light").rename(tmp_path / "shoot" / "pictures")
    times_s = np.linspace(0.003, 0.141, 16)
    rows = ["file,kind,exposure_s"]
    for path in sorted((tmp_path / "shoot" / "pictures").rglob("*.dng")):
        at = {"fl": 6, "da": 6, "sh": 0}.get(path.stem[:2])
        kind = "dark" if path.parent.name == "dark" else "light"
        rows.append(
            f"{path.relative_to(tmp_path / 'shoot')},{kind},{times_s[int(path.stem[:2]) if at is None else at]}"
        )
    (tmp_path / "shoot" / "sensor.csv").write_text("\n".join(rows))
    text = '[settings]\nplane = "G1"\n[limits]\nsystem_gain = { min = 0.1 }\n'
    rows, out = batch("sensor", text, tmp_path / "shoot", tmp_path / "dark_only")
    assert rows["dark_only/short0.dng"]["verdict"] in ("refused", "unreadable")
    (good,) = (row for row in rows.values() if row["verdict"] in ("pass", "doubtful"))
    gain = record_of(out, good, "sensor")["planes"]["G1"]["system_gain"]
    low, high = gain["interval"]
    assert low < 1 / 2.6 < high  # the simulated sensor has 2.6 electrons per number
    assert good["specification"] == "meets"


def test_renders_are_filtered_each_by_itself(batch, tmp_path):
    (tmp_path / "in").mkdir()
    cases.rays(tmp_path / "in")
    (tmp_path / "in" / "no_film.npz").write_bytes(b"no film")
    (tmp_path / "in" / "notes.png").write_bytes(b"is no film by its name")
    limits = "[limits]\nsimilar_patches = { min = 10 }\npsnr_filtered = { min = 30 }\n"
    rows, out = batch("rays", f"[settings]\nscales = 1\nthreads = 1\n{limits}", tmp_path / "in", options=("--reports",))
    assert rows.keys() == {"in/film.npz", "in/no_film.npz"}
    bad, good = rows["in/no_film.npz"], rows["in/film.npz"]
    assert bad["verdict"] == "unreadable"
    assert record_of(out, bad, "rays")["result"]["verdict"] == "refused"
    assert (good["verdict"], good["specification"]) == ("pass", "undecided")  # there is no truth to compare with
    record = record_of(out, good, "rays")
    assert record["parameters"]["scales"] == 1
    assert [one["verdict"] for one in record["result"]["specification"]["limits"]] == ["meets", "undecided"]
    assert {"filtered.tiff", "rays.html"} <= record["files"].keys()


def test_rigs_are_pairs_of_folders(batch, tmp_path):
    (tmp_path / "in").mkdir()
    words = cases.rig(tmp_path)
    for side, path in zip(("left", "right"), words[1:], strict=True):
        shutil.move(path, tmp_path / "in" / f"a_{side}")
    shutil.copytree(tmp_path / "in" / "a_left", tmp_path / "in" / "b_left")
    for side in ("left", "right"):
        (tmp_path / "in" / f"c_{side}").mkdir()
        (tmp_path / "in" / f"c_{side}" / "result.json").write_text(f'{{"procedure": "tilt", "side": "{side}"}}')
    rows, out = batch("rig", "[limits]\nbaseline = { min = 50, max = 52 }\n", tmp_path / "in")
    assert "has no partner" in rows["b_left/result.json"]["reason"]
    assert "is of tilt" in rows["c_left/result.json"]["reason"]
    good = rows["a_left/result.json"]
    assert (good["verdict"], good["specification"]) == ("pass", "meets")
    record = record_of(out, good, "rig")
    assert record["rig"]["specification"]["verdict"] == "meets"
    assert Path(good["folder"]).name.startswith("a_left-")
    assert record_of(out, rows["c_left/result.json"], "rig")["rig"]["verdict"] == "refused"
