import json

import numpy as np
import pytest

from tests.program import run

SLOW_FIXTURES = {"far"}


@pytest.fixture
def near(shared_data):
    return shared_data / "synthetic" / "two_photo" / "wall_a_near.pgm"


@pytest.fixture
def far(near):
    return near.with_name("wall_a_far.pgm")


def test_the_pair_is_measured_in_either_order(near, far, tmp_path):
    run("psf", "two-photo", far, near, "--out", tmp_path)
    record = json.loads((tmp_path / "result.json").read_text())
    assert [one["path"] for one in record["input"]] == [str(far), str(near)]
    assert record["choice"]["Y"][-1].items() >= {name: record["parameters"][name] for name in ("s", "k")}.items()
    assert record["planes"]["Y"]["verdict"] == "pass"
    assert record["planes"]["Y"]["scale"] == pytest.approx([4.9, 4.9], rel=1e-3)


def test_a_refusal_keeps_no_psf_and_names_the_remedy(near, tmp_path):
    out, same, again = tmp_path / "out", tmp_path / "same.pgm", tmp_path / "again.pgm"
    same.write_bytes(near.read_bytes())
    run("psf", "two-photo", near, same, "--out", out, code=4, says="inputs must differ")
    again.write_bytes(near.read_bytes()[:-1] + b"\0")
    run("psf", "two-photo", near, again, "--out", out, code=5)
    assert sorted(path.name for path in out.iterdir()) == ["result.json"]
    plane = json.loads((out / "result.json").read_text())["planes"]["Y"]
    assert plane["verdict"] == "refused"
    assert "times the near one's distance" in plane["reason"]
    assert "take the far photograph from 2.30 times its distance" in plane["remedy"]
    assert "choose s" not in plane["remedy"]  # no s of 2 or more is possible


def test_photographs_of_different_kinds_are_no_pair(near, shared_data, tmp_path):
    done = run("psf", "two-photo", near, shared_data / "raw" / "tinydng_colorchart.dng", "--out", tmp_path, code=4)
    assert "same planes" in done.output


def test_other_parameters_reach_the_estimate(near, far, tmp_path):
    run("psf", "two-photo", near, far, "-s", 2, "-k", 9, "--solver", "ls", "--out", tmp_path)
    assert np.load(tmp_path / "psf_Y.npy", allow_pickle=False).shape == (9, 9)
