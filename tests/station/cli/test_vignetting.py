"""`station vignetting`: flats that cannot be read, copies, limits of other planes."""

import json
import shutil

import cv2
import numpy as np
import pytest

from tests.program import run


@pytest.fixture
def flats(tmp_path, rng):
    """A folder of three photographs of even light."""
    folder = tmp_path / "flats"
    folder.mkdir()
    for name in "abc":
        light = rng.normal(20000, 60, (96, 128))
        cv2.imwrite(str(folder / f"{name}.png"), light.astype(np.uint16))
    return folder


def test_a_flat_that_cannot_be_read_is_named_and_excluded(flats, tmp_path):
    (flats / "a.png").write_bytes(b"no picture")
    run("vignetting", flats, "--out", tmp_path / "out", code=1, says=f"{flats / 'a.png'} ")
    record = json.loads((tmp_path / "out" / "result.json").read_text())
    assert [one["source"] for one in record["left_out"]] == [str(flats / "a.png")]
    assert record["planes"]["Y"]["corner_light"]["n"] == 2


def test_flats_of_which_none_can_be_read_are_refused(flats, tmp_path):
    for path in flats.iterdir():
        path.write_bytes(b"no picture")
    run("vignetting", flats, "--out", tmp_path / "out", code=4, says="none of 3 photographs can be used")
    assert not (tmp_path / "out").exists()


def test_a_copy_of_a_flat_is_no_second_one(flats, tmp_path):
    shutil.copy(flats / "a.png", flats / "d.png")
    run("vignetting", flats, "--out", tmp_path / "out", code=4, says="d.png has the content of")


def test_a_specification_of_other_planes_is_no_pass(flats, tmp_path):
    (tmp_path / "limits.toml").write_text('[limits]\ncorner_light = { min = 0.1, planes = ["G1"] }\n')
    words = "--specification", tmp_path / "limits.toml", "--strict"
    run(
        "vignetting", flats, *words, "--out", tmp_path / "out", code=1, says="no limit of the specification holds for Y"
    )
