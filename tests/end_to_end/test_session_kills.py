"""Sessions killed at random moments lose nothing; the benchmark of that name does it 500 times."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow
@pytest.mark.parametrize("kills", ["2", pytest.param("15", marks=pytest.mark.nightly)])
def test_killed_sessions_lose_nothing_and_come_to_the_same_result(kills):
    words = [sys.executable, "-m", "tests.benchmarks.session_kills", "--kills", kills, "--seed", "20120323"]
    done = subprocess.run(words, cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
