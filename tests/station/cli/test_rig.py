"""`station rig`: two results of geometry become the pose of one camera by the other."""

from __future__ import annotations

import json

import numpy as np
import pytest

from procedures.geometry.views import Pose
from tests.procedures.geometry.test_rig import FIRST, NAMES, TRUE, in_second

OTHERS = 40
"""Numbers of camera and chart before the poses' in a joint covariance."""


def write(folder, poses, procedure="geometry"):
    folder.mkdir()
    views = [
        {"source": name, "R": pose.R.tolist(), "t_mm": pose.t.tolist()} for name, pose in zip(NAMES, poses, strict=True)
    ]
    record = {
        "schema": "station/geometry/1", "procedure": procedure, "parameters": {"scale_uncertainty": 0.001},
        "planes": {"G1": {"verdict": "pass", "views": views}},
    }  # fmt: skip
    (folder / "result.json").write_text(json.dumps(record))
    scale = np.concatenate([np.full(OTHERS, 7.0), np.tile([1e-5, 1e-5, 1e-5, 0.01, 0.01, 0.02], len(views))])
    np.save(folder / "geometry_joint_covariance.npy", np.diag(scale**2))
    return folder


@pytest.fixture
def results(tmp_path):
    return write(tmp_path / "left", FIRST), write(tmp_path / "right", [in_second(one) for one in FIRST])


def test_the_second_camera_stands_where_it_does(run, results, tmp_path):
    done = run("rig", *results, "--out", tmp_path / "out", "--json")
    assert done.exit_code == 0, done.output
    record = json.loads(done.stdout)
    assert (record["schema"], record["rig"]["verdict"]) == ("station/rig/1", "pass")
    pose = Pose(np.array(record["rig"]["R"]), np.array(record["rig"]["t_mm"]))
    np.testing.assert_allclose(pose.R, TRUE.R, atol=1e-9)
    np.testing.assert_allclose(pose.t, TRUE.t, atol=1e-6)
    baseline = record["rig"]["baseline"]
    assert baseline["uncertainty"] > 0.001 * baseline["value"]  # the print's scale, and noise
    assert np.load(tmp_path / "out" / "rig_covariance.npy").shape == (6, 6)
    assert [one["path"] for one in record["input"]] == [str(one / "result.json") for one in results]


def test_one_camera_is_no_rig(run, results, tmp_path):
    done = run("rig", results[0], results[0], "--out", tmp_path / "out")
    assert done.exit_code == 4
    assert "are one geometry" in done.output


def test_what_is_no_geometry_is_refused(run, results, tmp_path):
    other = write(tmp_path / "other", FIRST, procedure="tilt")
    done = run("rig", results[0], other, "--out", tmp_path / "out")
    assert done.exit_code == 4
    assert "is of tilt" in done.output
    (results[1] / "geometry_joint_covariance.npy").unlink()
    assert run("rig", *results, "--out", tmp_path / "out").exit_code == 4
    assert not (tmp_path / "out").exists()
