"""`station rig`: results of geometry become the poses of the cameras by the first."""

import json
from pathlib import Path

import numpy as np
import pytest

from procedures import GeometryParameters, Outcome, Verdict, calibrate_geometry
from station.calibration.geometry import GeometryPhotographs, PlaneGeometry, ViewRecord
from station.calibration.geometry_files import geometry_measurement
from station.results.measurement import write_measurement
from station.results.record_head import RecordHead
from station.results.result_files import ResultFolder
from tests.procedures.geometry.simulated_views import CELL_MM
from tests.procedures.geometry.test_rig import HERE, LENSES, THIRD, TRUE, rig
from tests.program import run


def write(folder: Path, count: int = 2) -> list[Path]:
    """Results of geometry of the cameras of a rig: the folders left, right, third."""
    folders = []
    for i, one in enumerate(rig(np.random.default_rng(1), (HERE, TRUE, THIRD)[:count])):
        parameters = GeometryParameters(CELL_MM, 0.001, "OPENCV")
        outcome = calibrate_geometry(one.views, LENSES[i].size, parameters, one.nodes)
        records = tuple(ViewRecord(Path(view.source), "0" * 64, view, Verdict.PASS) for view in one.views)
        shoot = GeometryPhotographs("G1", LENSES[i].size, records)
        head = RecordHead("geometry", (), {"scale_uncertainty": 0.001})
        folders.append(folder / ("left", "right", "third")[i])
        with ResultFolder(folders[-1]) as results:
            plane = PlaneGeometry(shoot, Outcome(outcome.value, Verdict.PASS))
            write_measurement(results, geometry_measurement([plane], head))
    return folders


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    return write(tmp_path_factory.mktemp("rig"), 3)


def test_the_cameras_stand_where_they_do(results, tmp_path):
    done = run("rig", *results, "--out", tmp_path / "out", "--json")
    record = json.loads(done.stdout)
    assert (record["schema"], record["rig"]["verdict"]) == ("station/rig/1", "pass")
    covariance = np.load(tmp_path / "out" / "rig_covariance.npy")
    assert covariance.shape == (12, 12)
    for i, (one, truth) in enumerate(zip(record["rig"]["cameras"], (TRUE, THIRD), strict=True)):
        error = np.array(one["t_mm"]) - np.array(one["R"]) @ truth.R.T @ truth.t
        assert np.abs(error / np.sqrt(np.diag(covariance))[6 * i + 3 : 6 * i + 6]).max() < 2.5
        assert one["baseline"]["uncertainty"] > 0.001 * one["baseline"]["value"]  # the print's scale, and noise
    assert record["rig"]["t_mm"] == record["rig"]["cameras"][0]["t_mm"]
    assert "rotation vector w in radians" in record["rig"]["convention"]
    assert [one["path"] for one in record["input"]] == [str(one / "result.json") for one in results]


def test_one_camera_is_no_rig(results, tmp_path):
    run("rig", results[0], results[0], "--out", tmp_path / "out", code=4, says="are one geometry")
    done = run("rig", results[0], "--out", tmp_path / "out", code=None)
    assert "two cameras or more" in done.output


@pytest.fixture
def copies(results, tmp_path):
    """Two results that may be changed."""
    for folder in results[:2]:
        (tmp_path / folder.name).mkdir()
        for file in folder.iterdir():
            (tmp_path / folder.name / file.name).write_bytes(file.read_bytes())
    return tmp_path / "left", tmp_path / "right"


def test_what_is_no_geometry_is_refused(copies, tmp_path):
    record = json.loads((copies[1] / "result.json").read_text())
    (copies[1] / "result.json").write_text(json.dumps(record | {"procedure": "tilt"}))
    run("rig", *copies, "--out", tmp_path / "out", code=4, says="is of tilt")


def test_a_result_without_points_is_refused_with_a_remedy(copies, tmp_path):
    (copies[1] / "geometry_points.npy").unlink()
    run("rig", *copies, "--out", tmp_path / "out", code=4, says="calibrate the camera again")
    assert not (tmp_path / "out").exists()
