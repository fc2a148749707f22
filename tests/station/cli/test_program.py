"""The program as a process: what a shell sees."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = ("numpy", "scipy", "cv2", "rawpy", "exifread", "numba", "rich", "reportlab", "jinja2", "procedures.raw")


def station(*words):
    return subprocess.run(
        [sys.executable, "-m", "station", *map(str, words)], capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize("words", [("--help",), ("psf", "--help"), ("psf", "pattern", "--help")])
def test_help_loads_nothing_heavy(words):
    script = (
        "import sys; from station.__main__ import main; main(sys.argv[1:], standalone_mode=False);"
        f"loaded = [name for name in {HEAVY} if name in sys.modules]; assert not loaded, loaded"
    )
    done = subprocess.run([sys.executable, "-c", script, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "Usage:" in done.stdout


def test_truncated_photograph_ends_with_one_sentence_and_exit_4(shared_data, tmp_path):
    cut = tmp_path / "cut.dng"
    cut.write_bytes((shared_data / "raw" / "tinydng_colorchart.dng").read_bytes()[:1_000_000])
    done = station("psf", "pattern", cut, "--out", tmp_path / "out", "--json")
    assert done.returncode == 4, done.stderr
    assert done.stdout == ""
    sentence, remedy = done.stderr.splitlines()
    assert "truncated or damaged" in sentence
    assert remedy.startswith("  what to do: copy it")


def test_unknown_command_is_usage():
    assert station("conjure").returncode == 2
