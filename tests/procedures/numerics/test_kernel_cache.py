"""An installation that nobody may write to, and no place for caches: everything works, and that is said once."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from procedures.numerics import kernel_cache

ROOT = Path(kernel_cache.__file__).parents[2]
PROGRAM = """
import subprocess, sys
import numpy as np
from procedures.restoration.first_depth import semi_global_matching
from procedures.restoration.masks import array_loops, kernels
from procedures.restoration.masks.line_rasterisation import line_mask
from procedures.ray_histogram.film import film_of_samples

assert film_of_samples(np.ones((2, 2, 3, 3), np.float32)).count.tolist() == [[3, 3], [3, 3]]
mask = line_mask(np.array([[0.25, 0.0]]), 2, 0.5)
assert abs(mask.sum() - 1) < 1e-3, mask  # a narrow line in the middle
{more}
"""
LATER = "from procedures.restoration.masks import line_rasterisation"
AGAIN = f"subprocess.run([sys.executable, '-c', '{LATER}'], check=True)"


@pytest.fixture
def read_only(tmp_path):
    """The procedures in a folder that cannot be written, and the words before a command that may not do so as root."""
    words = []
    if os.geteuid() == 0:
        if shutil.which("setpriv") is None:
            pytest.skip("root writes everywhere, and there is no setpriv to give that up")
        words = ["setpriv", "--bounding-set=-dac_override,-dac_read_search,-fowner"]
    place = tmp_path / "installed"
    shutil.copytree(ROOT / "procedures", place / "procedures", ignore=shutil.ignore_patterns("__pycache__"))
    folders = [path for path in (place, *place.rglob("*")) if path.is_dir()]
    for folder in folders:
        folder.chmod(0o555)
    yield place, words
    for folder in folders:
        folder.chmod(0o755)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="folders there have no such permissions")
def test_read_only_installation_without_a_cache_computes_and_says_so_once(read_only):
    place, words = read_only
    unset = ("HOME", "NUMBA_CACHE_DIR", "PYTHONDONTWRITEBYTECODE", kernel_cache.SAID)
    environment = {name: value for name, value in os.environ.items() if name not in unset}
    environment |= {"XDG_CACHE_HOME": "/dev/null/none", "PYTHONPATH": str(place)}
    command = [*words, sys.executable, "-W", "error", "-c", PROGRAM.format(more=AGAIN)]
    done = subprocess.run(command, env=environment, cwd=place, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("compiled code cannot be kept") == 1
    assert "set NUMBA_CACHE_DIR" in done.stderr
    assert list(place.rglob("__pycache__")) == []
