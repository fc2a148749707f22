"""`station restore` from files to files, on a corner of the shared photographs."""

import json
from functools import partial, partialmethod

import cv2
import numpy as np
import pytest

from procedures.restoration.joint.schedule import Scheme
from procedures.restoration.unknown_motion.path_refinement import PathEffort
from tests.program import run

pytestmark = pytest.mark.slow
QUICK = ["--scheme", "2x(4+4)+1x6", "--max-w", "5.2"]


@pytest.fixture(scope="module")
def photographs(shared_data, tmp_path_factory):
    """A corner of the vibrating pair, its shapes, and the truth there."""
    folder = shared_data / "synthetic" / "restoration"
    target = tmp_path_factory.mktemp("photographs")
    for n in (1, 2):
        image = cv2.imread(str(folder / f"vibration_40dB_{n}.pgm"), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(target / f"{n}.pgm"), image[100:200, 180:300])
    shapes = [str(folder / f"vibration_shape{n}.txt") for n in (1, 2)]
    return [str(target / "1.pgm"), str(target / "2.pgm")], shapes, np.load(folder / "w.npy")[100:200, 180:300]


restore = partial(run, "restore")


@pytest.fixture(scope="module")
def done(photographs, tmp_path_factory):
    images, shapes, _ = photographs
    out = tmp_path_factory.mktemp("out") / "restored"
    result = restore(*images, "--blur", "motion", "--shape", *shapes, *QUICK, "--json", "--out", out)
    return result, out


def test_files_picture_and_depth_are_those_of_the_photographs(done, photographs):
    _, out = done
    assert {"sharp.tiff", "sharp.png", "w.npy", "depth.png", "result.json"} <= {f.name for f in out.iterdir()}
    assert not [f for f in out.iterdir() if f.name.startswith(".")]
    sharp = cv2.imread(str(done[1] / "sharp.tiff"), cv2.IMREAD_UNCHANGED)
    before = cv2.imread(photographs[0][0], cv2.IMREAD_UNCHANGED) / 65535
    assert sharp.dtype == np.float32
    assert sharp.shape == before.shape
    # blur and its inverse preserve the mean except for light that crosses the frame
    assert sharp.mean() == pytest.approx(before.mean(), rel=0.02)
    w = np.load(done[1] / "w.npy")
    assert w.dtype == np.float32
    assert np.median(np.abs(w - photographs[2])) < 0.1


def test_one_photograph_is_a_usage_error(photographs, tmp_path):
    restore(photographs[0][0], "--blur", "defocus", "--shape", "pillbox", "--ratio", "1.2", "--out", tmp_path, code=2)


def test_unknown_motion_comes_from_a_flat_part(photographs, tmp_path, monkeypatch):
    # the accuracy of the paths is tested with the procedure
    few = {"beginnings": 3, "descending": 1, "bends": 0, "restored": 1, "more": 0, "scheme": Scheme(1, 2, 2, 1, 2)}
    monkeypatch.setattr(PathEffort, "__init__", partialmethod(PathEffort.__init__, **few))
    # the upper left corner of this crop is at one depth to half a pixel
    arguments = ["--blur", "motion", "--prototype-region", "0,0,60,96", "--scheme", "1x(2+2)", "--max-w", "3"]
    restore(*photographs[0], *arguments, "--depth-total-variation", "--out", tmp_path / "o")
    record = json.loads((tmp_path / "o" / "result.json").read_text())
    assert record["parameters"]["prototype_region"] == "0,0,60,96"
    assert record["parameters"]["motion"]["half_width_px"] > 0
    # the record has a path, or the reason why there is none
    assert record["parameters"]["motion"]["paths_px"] or record["reason"]
    # its shapes are used again, with their caveat and without the search
    shapes = [tmp_path / "o" / f"shape_{n}.npy" for n in (1, 2)]
    arguments = ["--blur", "motion", "--shape", *shapes, "--scheme", "1x(2+2)", "--max-w", "3"]
    restore(*photographs[0], *arguments, "--depth-total-variation", "--out", tmp_path / "again")
    again = json.loads((tmp_path / "again" / "result.json").read_text())
    assert again["verdict"] == record["verdict"] == "doubtful"
    np.testing.assert_allclose(np.load(tmp_path / "again" / "w.npy"), np.load(tmp_path / "o" / "w.npy"), atol=0.02)


def test_photographs_of_two_scenes_exit_5_and_leave_the_reason(photographs, tmp_path):
    images, shapes, _ = photographs
    second = cv2.imread(images[1], cv2.IMREAD_UNCHANGED)
    cv2.imwrite(str(tmp_path / "negative.pgm"), second.max() + second.min() - second)
    blur = ["--blur", "motion", "--shape", *shapes, *QUICK]
    result = restore(images[0], tmp_path / "negative.pgm", *blur, "--out", tmp_path / "o", code=5)
    assert "no picture explains the photographs" in result.stderr
    record = json.loads((tmp_path / "o" / "result.json").read_text())
    assert (record["schema"], record["verdict"]) == ("station/restore/1", "refused")
    assert record["reason"] in result.stderr
    assert record["remedy"]
    assert [file.name for file in (tmp_path / "o").iterdir()] == ["result.json"]
