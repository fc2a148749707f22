"""Mutated files of every format end in a result or a stated refusal; the benchmark of that name reads thousands."""

import os
import random
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.benchmarks.fuzz_files import READERS

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the readers' memory is limited as Linux does it")
@pytest.mark.parametrize(
    ("mutations", "only"),
    [
        (12, ",".join(random.SystemRandom().sample(sorted(READERS), 12))),
        pytest.param(400, "", marks=pytest.mark.nightly),
    ],
    ids=["some", "all"],
)
def test_mutated_files_are_read_or_refused(mutations, only):
    pytest.importorskip("OpenEXR")
    # other formats and mutations in each run; the seed that is printed repeats it
    words = [sys.executable, "-m", "tests.benchmarks.fuzz_readers", "--mutations", str(mutations), "--only", only]
    done = subprocess.run(words, cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    # as many for every reader
    assert int(re.search(r"(\d+) mutations, seed", done.stdout)[1]) > 0.8 * mutations
