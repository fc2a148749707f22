import importlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

from procedures.numerics.compiled import _cache_folder, compiled, vectorised

ROOT = Path(__file__).resolve().parents[3]

DECORATORS = {"compiled": compiled, "vectorised": vectorised}


@pytest.mark.parametrize("name", DECORATORS)
def test_kernels_work_where_nothing_can_be_kept(name):
    # a function without a source file cannot be kept on disk, as in a checkout and a home that cannot be written
    namespace = {}
    exec("def halves(x):\n    return x / 2.0", namespace)
    kernel = DECORATORS[name](namespace["halves"])
    assert kernel(3.0) == 1.5


def test_strict_kernels_keep_nan():
    @compiled
    def finite(x):
        return np.isfinite(x)

    assert not finite(np.nan)
    assert not finite(np.inf)
    assert finite(1.0)


def test_a_loop_is_compiled_anew_when_a_constant_of_another_file_changes(tmp_path, monkeypatch):
    # Numba alone keeps the old value: it looks at the loop's own file only
    package = tmp_path / "toy"
    package.mkdir()
    (package / "__init__.py").touch()
    loop = "from procedures.numerics.compiled import compiled\nfrom toy.size import SIZE\n"
    (package / "loops.py").write_text(f"{loop}@compiled\ndef size():\n    return SIZE\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "kept"))
    kept = []
    for value in (3, 4, 3):
        (package / "size.py").write_text(f"SIZE = {value}\n")
        _cache_folder.cache_clear()  # as in another process
        for name in ("toy", "toy.size", "toy.loops"):
            monkeypatch.delitem(sys.modules, name, raising=False)
        size = importlib.import_module("toy.loops").size
        assert size() == value
        kept.append(sum(size.stats.cache_hits.values()))
    assert kept == [0, 0, 1]
    assert len(list((tmp_path / "kept" / "calibration-station").iterdir())) == 2


PROGRAM = """
import numpy as np
from procedures.restoration.masks.line_rasterisation import line_mask
from procedures.ray_histogram.film import film_of_samples

assert film_of_samples(np.ones((2, 2, 3, 3), np.float32)).count.tolist() == [[3, 3], [3, 3]]
mask = line_mask(np.array([[0.25, 0.0]]), 2, 0.5)
assert abs(mask.sum() - 1) < 1e-3, mask  # a narrow line in the middle
"""


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
    unset = ("HOME", "NUMBA_CACHE_DIR", "PYTHONDONTWRITEBYTECODE")
    environment = {name: value for name, value in os.environ.items() if name not in unset}
    environment |= {"XDG_CACHE_HOME": "/dev/null/none", "PYTHONPATH": str(place)}
    command = [*words, sys.executable, "-W", "error", "-c", PROGRAM]
    done = subprocess.run(command, env=environment, cwd=place, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("compiled code cannot be kept") == 1
    assert "set NUMBA_CACHE_DIR" in done.stderr
    assert list(place.rglob("__pycache__")) == []
