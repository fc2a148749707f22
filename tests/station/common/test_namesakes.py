"""A foreign package of the same name is named at the start, with the way out."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]


def started(folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "station", "--version"], capture_output=True, text=True, check=False,
        cwd=folder, env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip


@pytest.mark.parametrize("module", ["procedures/__init__.py", "drivers.py"])
def test_a_foreign_package_is_named_with_the_way_out(tmp_path, module):
    foreign = tmp_path / module
    foreign.parent.mkdir(exist_ok=True)
    foreign.touch()
    done = started(tmp_path)
    assert done.returncode == 1
    name, place = module.split("/")[0].removesuffix(".py"), foreign.parent if "/" in module else foreign
    assert f"another package `{name}` in {place}" in done.stderr
    assert "remove its folder from PYTHONPATH" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_folder_that_is_no_package_is_in_nobody_s_way(tmp_path):
    (tmp_path / "drivers").mkdir()
    done = started(tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
