"""What `conftest.py` sets up for all tests."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PROGRAM = """
import subprocess, sys
import tests.conftest
subprocess.run([sys.executable, "-c", "import signal; print(signal.getsignal(signal.SIGHUP) == signal.SIG_DFL)"])
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="no terminals that hang up here")
def test_programs_that_tests_start_hear_a_hangup_though_the_tests_were_started_by_nohup():
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], cwd=ROOT, capture_output=True, text=True, check=True,
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN),
    )  # fmt: skip
    assert done.stdout == "True\n"


LEFT: list[subprocess.Popen[bytes]] = []


def test_a_program_may_be_left_running(start_program):
    LEFT.append(start_program([sys.executable, "-c", "import time; time.sleep(600)"]))
    assert LEFT[0].poll() is None


def test_and_has_ended_afterwards():
    assert all(program.poll() == -signal.SIGKILL for program in LEFT)
