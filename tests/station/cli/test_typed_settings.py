"""`--trust-typed`: typed settings against the camera's metadata, in every command with the option."""

import json

import pytest

from procedures.raw import read_frame
from tests.program import run


@pytest.fixture
def photograph(chart_photograph, tmp_path):
    path = chart_photograph(tmp_path / "photographs" / "frame.dng")
    assert read_frame(path).exposure.f_number == 2.8
    return path


@pytest.mark.slow
@pytest.mark.parametrize("command", ["psf pattern", "psf two-photo", "psf field", "mtf edge"])
def test_f_number_that_contradicts_the_file_is_refused_with_both(estimator, photograph, tmp_path, command):
    images = {"psf two-photo": [photograph, photograph], "psf field": [photograph.parent]}.get(command, [photograph])
    done = run(*command.split(), *images, "--f-number", 5.6, "--pixel-pitch-um", 5, "--out", tmp_path / "out", code=2)
    assert f"{photograph}: the f-number was given as 5.6, but the camera recorded 2.8" in done.output
    assert "what to do: omit or correct it; to keep it, add --trust-typed" in done.stderr
    assert not (tmp_path / "out").exists()
    assert estimator.asked == []


def test_insisting_takes_what_was_typed_and_is_in_the_record_where_it_contradicts(estimator, photograph, tmp_path):
    words = ("--f-number", 5.6, "--pixel-pitch-um", 5, "--trust-typed", "--out", tmp_path / "out")
    run("psf", "pattern", photograph, *words)
    given = json.loads((tmp_path / "out" / "result.json").read_text())["parameters"]
    assert (given["f_number"], given["trust_typed"]) == (5.6, True)
    run("psf", "pattern", photograph, "--f-number", 2.83, "--pixel-pitch-um", 5, "--out", tmp_path / "out")
    assert "trust_typed" not in json.loads((tmp_path / "out" / "result.json").read_text())["parameters"]
