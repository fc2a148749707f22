"""The program as a process: what a shell sees."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.program import run

ROOT = Path(__file__).resolve().parents[3]
HEAVY = ("numpy", "scipy", "cv2", "rawpy", "exifread", "numba", "rich", "reportlab", "jinja2", "procedures.raw")
OF_SETTINGS = ("numpy", "cv2", "procedures.raw")
"""What the options of a procedure need, which are those of its settings."""
WORDS = "", "psf", "session", "psf pattern", "psf field", "mtf edge", "geometry", "tilt", "correct", "restore"
HELP = f"""
import sys
from station.__main__ import main
for words in {WORDS}:
    main([*words.split(), "--help"], standalone_mode=False)
    needed = {OF_SETTINGS} if words not in {WORDS[:3]} else ()
    loaded = [one for one in {HEAVY} if one in sys.modules and one not in needed]
    assert not loaded, (words, loaded)
"""


def test_help_loads_nothing_heavy():
    done = subprocess.run([sys.executable, "-c", HELP], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("Usage:") == len(WORDS)


@pytest.mark.skipif(sys.platform == "win32", reason="closes streams in a shell")
@pytest.mark.parametrize(
    ("words", "code"),
    [
        ("--plain --simulate <&-", 130),
        ("--plain --simulate </dev/null >&-", 130),
        ("--simulate <&-", 2),
        ("conform grbl --port /dev/nonexistent <&-", 130),
    ],
)
def test_a_closed_stream_is_an_input_that_has_ended_or_an_output_without_a_reader(tmp_path, words, code):
    done = subprocess.run(
        ["sh", "-c", f"{sys.executable} -m station {words}"], cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == code, done.stderr
    assert "unexpectedly" not in done.stderr


@pytest.mark.slow
def test_truncated_photograph_ends_with_one_sentence_and_exit_4(shared_data, tmp_path):
    cut = tmp_path / "cut.dng"
    cut.write_bytes((shared_data / "raw" / "tinydng_colorchart.dng").read_bytes()[:1_000_000])
    # in a process of its own, for libraries write to the terminal too
    words = [sys.executable, "-m", "station", "psf", "pattern", cut, "--out", tmp_path / "out", "--json"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (4, "")
    sentence, remedy = done.stderr.splitlines()
    assert "truncated or damaged" in sentence
    assert remedy.startswith("  what to do: copy it")


@pytest.mark.slow
def test_real_photograph_passes(shared_data, tmp_path):
    folder = shared_data / "pattern_photo"
    words = folder / "img_example.pgm", "--bits", folder / "pattern_noise.pgm", "--out", tmp_path, "--json"
    assert json.loads(run("psf", "pattern", *words).stdout)["planes"]["Y"]["verdict"] == "pass"
    assert abs(np.load(tmp_path / "psf_Y.npy").sum() - 1) < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize(
    ("photograph", "words", "remedy"),
    [("edges/Test_edge1_mono.tif", (), "what to do: "), ("pattern_photo/img_example.pgm", ("--seed", 3), "--bits")],
)
def test_a_missing_chart_and_wrong_cells_are_exit_5(shared_data, tmp_path, photograph, words, remedy):
    run("psf", "pattern", shared_data / photograph, *words, "--out", tmp_path, code=5, says=remedy)
    assert {path.name for path in tmp_path.iterdir()} == {"result.json"}


def test_unknown_commands_and_a_shaker_without_a_bench_are_usage_errors():
    run("--shaker", "--plain", code=2, says="--shaker is for the simulated bench: give --simulate")
    run("conjure", code=2)
    run("explain", "", code=2, says="a path must not be empty")
