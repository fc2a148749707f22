"""Records of every procedure read back as they were written, and damaged ones refused."""

import json
import math
import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from procedures.outcome import BadInput, Quantity, Verdict
from station.results import reader
from station.results.comparison import Compliance
from station.results.plane_result import PlaneResult
from station.results.reader import changes, find_results, read_picture, read_result
from station.results.result_files import plain
from station.results.units import Unit

FROZEN = Path(__file__).resolve().parents[2] / "golden" / "frozen"
RECORDS = [
    pytest.param(record, id=f"{path.stem} {name}")
    for path in sorted(FROZEN.glob("*.json"))
    if isinstance(records := json.loads(path.read_text(encoding="utf-8")), dict)
    for name, record in records.items()
    if name.endswith("result.json") and not record["schema"].startswith("station/batch/")
]


def written(folder, record):
    (folder / "result.json").write_text(json.dumps(record), encoding="utf-8")
    return folder


def record(**planes):
    return {"schema": "station/psf/1", "procedure": "pattern", "input": [], "parameters": {}, "planes": planes}


@pytest.mark.parametrize("frozen", RECORDS)
def test_a_record_is_read_as_it_was_written(frozen, tmp_path):
    frozen = frozen | {"input": [{**one, "sha256": "ab" * 32} for one in frozen["input"]]}
    read = plain(read_result(written(tmp_path, frozen)).record())
    left_out = {"files", "sha256", "software"}
    assert {k: v for k, v in read.items() if k not in left_out} == {
        k: v for k, v in frozen.items() if k not in left_out
    }


def test_curves_and_samples_are_read_beside_the_record_unless_it_was_refused(tmp_path):
    np.save(tmp_path / "psf_G1.npy", np.full((3, 3), 1 / 9))
    (tmp_path / "mtf_G1.csv").write_text("frequency [cycles/pixel],mtf\n0,1\n0.25,0.5\n")
    (plane,) = read_result(written(tmp_path, record(G1={"verdict": "pass", "s": 4}))).planes
    assert (plane.unit, plane.values["s"]) == (Unit.CYCLES, 4.0)
    np.testing.assert_array_equal(plane.samples, np.full((3, 3), 1 / 9))
    np.testing.assert_array_equal(plane.curves["mtf"], [1, 0.5])
    (plane,) = read_result(written(tmp_path, record(G1={"verdict": "refused"}))).planes
    assert (plane.samples, plane.curves) == (None, {})


def test_limits_and_unusable_photographs_are_read(tmp_path):
    limit = {
        "number": "mtf50", "verdict": "meets", "value": 0.3, "uncertainty": 0.01, "min": 0.2, "max": None,
        "unit": "cycles/pixel", "place": "G1", "words": "it is",
    }  # fmt: skip
    plane = {"verdict": "pass", "specification": {"verdict": "meets", "limits": [limit]}, "unavailable": ["gamma"]}
    missed = [{"source": "a.dng", "reason": "dark", "remedy": "light"}, "no entry"]
    result = read_result(written(tmp_path, {**record(G1=plane), "left_out": missed}))
    compared = result.planes[0].specification
    assert compared.judged is Compliance.MEETS
    assert (compared.judgements[0].least, compared.judgements[0].most) == (0.2, None)
    assert result.planes[0].unavailable == ("gamma",)
    assert [(one.source, one.reason, one.remedy) for one in result.missed] == [("a.dng", "dark", "light")]
    assert read_result(written(tmp_path, record(G1=plane))).missed is None


def test_a_refusal_without_planes_is_a_result_without_numbers(tmp_path):
    head = {**record(), "verdict": "refused", "reason": "dark", "remedy": "light"}
    del head["planes"]
    (plane,) = read_result(written(tmp_path, head)).planes
    assert (plane.name, plane.verdict, plane.reason, plane.remedy) == ("result", Verdict.REFUSED, "dark", "light")


@pytest.mark.parametrize("number", [True, "0.3", None])
def test_a_number_that_is_none_is_nan(number, tmp_path):
    entry = {"verdict": "pass", "mtf50": {"value": number, "unit": "cycles/pixel", "uncertainty": 0.1, "n": "many"}}
    found = read_result(written(tmp_path, record(Y=entry))).planes[0].numbers["mtf50"]
    assert found.value == 1 if number is True else math.isnan(found.value)
    assert (found.uncertainty, found.n, found.method) == (0.1, 0, "")
    del entry["mtf50"]["n"]
    found = read_result(written(tmp_path, record(Y=entry))).planes[0].numbers["mtf50"]
    assert (found.unit, found.n) == ("cycles/pixel", 0)


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("[]", "is no record of a result"),
        ("{", "result.json"),
        ("{}", "names no planes"),
        (json.dumps(record()), "names no planes"),
        (json.dumps(record(Y=3)), "names no planes"),
        (json.dumps(record(**{"../Y": {"verdict": "pass"}})), "names no planes"),
        (json.dumps(record(ABCDEFGHI={"verdict": "pass"})), "names no planes"),
        (json.dumps(record(Y={"verdict": "good"})), "plane Y has no verdict"),
    ],
)
def test_a_damaged_record_is_refused(content, complaint, tmp_path):
    (tmp_path / "result.json").write_text(content)
    with pytest.raises(BadInput, match=complaint):
        read_result(tmp_path)


@pytest.mark.parametrize(
    "table", ["", "frequency [cycles/pixel],mtf\n0,1\n", "frequency [cycles/pixel],other\n0,1\n0.5,1\n", "\x00"]
)
def test_a_table_that_is_no_mtf_is_refused(table, tmp_path):
    (tmp_path / "mtf_Y.csv").write_text(table)
    with pytest.raises(BadInput, match="is no table of an MTF"):
        read_result(written(tmp_path, record(Y={"verdict": "pass"})))


def test_a_file_that_is_too_large_or_absent_is_refused(tmp_path, monkeypatch):
    with pytest.raises(BadInput, match="cannot be read"):
        read_result(tmp_path)
    size = written(tmp_path, record(Y={"verdict": "pass"})).joinpath("result.json").stat().st_size
    monkeypatch.setattr(reader, "MAX_BYTES", size)
    assert read_result(tmp_path).planes[0].verdict is Verdict.PASS
    monkeypatch.setattr(reader, "MAX_BYTES", size - 1)
    with pytest.raises(BadInput, match=f"is larger than {size - 1} bytes"):
        read_result(tmp_path)


def test_results_of_sessions_are_found_the_newest_first(tmp_path):
    for age, name in enumerate(("a/derived/1", "b/derived/1", "a/derived/2", "a/elsewhere/1")):
        (tmp_path / name).mkdir(parents=True)
        os.utime(written(tmp_path / name, {}) / "result.json", (0, 1000 - age))
    (tmp_path / "b/derived/2").symlink_to(tmp_path / "b/derived/1")
    assert find_results(tmp_path) == [tmp_path / name for name in ("a/derived/1", "b/derived/1", "a/derived/2")]


def test_a_picture_is_read_as_brightness(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.full((2, 3, 3), 70, np.uint8))
    np.testing.assert_array_equal(read_picture(tmp_path / "a.png"), np.full((2, 3), 70))
    for content in (b"", b"no picture"):
        (tmp_path / "b.png").write_bytes(content)
        with pytest.raises(BadInput, match="is no picture"):
            read_picture(tmp_path / "b.png")


def test_changes_are_in_uncertainties_of_the_difference():
    def of(**numbers):
        quantities = {name: Quantity(value, "pixel", u, "", 1) for name, (value, u) in numbers.items()}
        return PlaneResult("Y", Verdict.PASS, "", "", quantities)

    found = changes(of(a=(1.0, 0.3), b=(2.0, 0.0), c=(1.0, 0.1)), of(a=(2.0, 0.4), b=(2.0, 0.0), d=(1.0, 0.1)))
    assert [one.name for one in found] == ["a", "b"]
    assert found[0].sigmas == pytest.approx(2)  # 1 over the root of 0.3^2 + 0.4^2
    assert math.isnan(found[1].sigmas)
    assert replace(found[0], other=found[0].one).sigmas == 0
