"""The house rules, run with the tests: `.ci/check` says what they are."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.parametrize("rule", ["style", "format", pytest.param("types", marks=pytest.mark.slow), "imports"])
def test_house_rule(rule: str) -> None:
    environment = {**os.environ, "PYTHON": sys.executable}
    done = subprocess.run([ROOT / ".ci" / "check", rule], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_folder_holds_at_most_twenty_modules() -> None:
    folders = {
        path.parent
        for room in ("station", "drivers", "procedures", "simulators")
        for path in ROOT.glob(f"{room}/**/*.py")
    }
    assert {str(one.relative_to(ROOT)): n for one in folders if (n := len(list(one.glob("*.py")))) > 20} == {}
