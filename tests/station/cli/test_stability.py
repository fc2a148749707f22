"""`station psf stability`: numbers, table and page from the folders of results, and results without a PSF."""

import json

import numpy as np
import pytest

from tests.program import run


@pytest.fixture
def results(tmp_path):
    return write_results(tmp_path)


def write_results(place):
    rng, folders = np.random.default_rng(3), [place / f"r{i}" for i in range(3)]
    for folder in folders:
        folder.mkdir()
        np.save(folder / "psf_Y.npy", np.outer(*[np.hanning(19)[1:-1]] * 2) / 81 + 1e-4 * rng.standard_normal((17, 17)))
        record = {"schema": "station/psf/1", "procedure": "pattern", "input": [], "parameters": {"s": 4, "k": 17},
                  "planes": {"Y": {"verdict": "pass"}}}  # fmt: skip
        (folder / "result.json").write_text(json.dumps(record))
    return folders


def test_results_of_one_camera_give_sensitivity_and_stable_domain(results, tmp_path):
    run("psf", "stability", *results, "--limit", 0.02, "--out", tmp_path / "o")
    plane = json.loads((tmp_path / "o" / "result.json").read_text())["planes"]["Y"]
    assert plane["mtf_sensitivity"]["value"] > plane["mtf_sensitivity_above_5_percent"]["value"] > 0
    table = np.loadtxt(tmp_path / "o" / "stability_Y.csv", delimiter=",", skiprows=1)
    assert table[0, 1] == pytest.approx(plane["mtf_sensitivity"]["value"], rel=1e-5)
    assert "Relative sensitivity" in (tmp_path / "o" / "report.html").read_text()


def test_a_result_without_a_psf_is_named(results, tmp_path):
    (results[1] / "psf_Y.npy").unlink()
    run("psf", "stability", *results, "--out", tmp_path / "o", code=4, says="r1 has no PSF")
    said = run("psf", "stability", results[0], "nosuch", results[0], "--out", tmp_path / "o", code=4).stderr
    assert "nosuch/result.json cannot be read: No such file or directory" in said
    assert "compute the result again, or name another" in said


def test_results_of_one_photograph_are_no_repetition(results, tmp_path):
    for folder in results[:2]:
        record = json.loads((folder / "result.json").read_text())
        record["input"] = [{"path": f"{folder.name}.dng", "sha256": "a" * 64}]
        (folder / "result.json").write_text(json.dumps(record))
    run("psf", "stability", *results, "--out", tmp_path / "o", code=4, says="r1 has the content of")
