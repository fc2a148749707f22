"""`station conform`: page and record, and what is missing."""

from __future__ import annotations

import re

import pytest


@pytest.mark.slow
def test_the_command_writes_a_page_that_it_verifies(run, tmp_path):
    done = run("conform", "smc100", "--operations", "5", "--out", str(tmp_path / "out"))
    assert done.exit_code == 0, done.output
    assert (tmp_path / "out" / "conformance.html").exists()
    checked = run("conform", "--verify", str(tmp_path / "out"))
    assert checked.exit_code == 0, checked.output
    assert re.search(r"signature +not compared +the record is not signed", checked.stdout)


@pytest.mark.parametrize(
    ("words", "complaint"),
    [((), "Missing argument 'DRIVER'"), (("gcs", "--key", "key.pem"), "--key signs a record: give --out as well")],
)
def test_what_is_missing_is_said(run, words, complaint):
    done = run("conform", *words)
    assert done.exit_code == 2
    assert complaint in done.stderr
