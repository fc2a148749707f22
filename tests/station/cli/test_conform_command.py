"""`station conform`: page and record, and what is missing."""

import re

import pytest

from tests.program import run


@pytest.mark.slow
def test_the_command_writes_a_page_that_it_verifies(tmp_path):
    run("conform", "smc100", "--operations", "5", "--out", str(tmp_path / "out"))
    assert (tmp_path / "out" / "conformance.html").exists()
    checked = run("conform", "--verify", str(tmp_path / "out"))
    run("conform", "--verify", str(tmp_path / "out"), "--strict", code=1)
    assert re.search(r"signature +not compared +the record is not signed", checked.stdout)


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ((), "Give either a DRIVER or --device"),
        (("gcs", "--key", "key.pem"), "--key signs a record: give --out as well"),
    ],
)
def test_what_is_missing_is_said(words, complaint):
    run("conform", *words, code=2, says=complaint)


def test_a_device_that_is_not_there_is_named(tmp_path):
    (tmp_path / "station.toml").write_text(
        '[devices.rail]\ndriver = "gcs"\nport = "x"\naxes = [{name = "x_mm", number = "1"}]\n'
    )
    done = run("conform", "--device", "stage", "--config", tmp_path / "station.toml", code=2)
    assert "has no device stage" in done.stderr
    assert "name one of rail" in done.stderr
