"""What `station tilt` must know is asked for before any photograph is measured."""

import numpy as np
import pytest

from tests.program import run

OPTICS = ("--pixel-pitch-um", 5.0, "--focal-length-mm", 50.0)
SCREWS = ("--screw-radius-mm", 20, "--screw-pitch-mm", 0.35)


@pytest.fixture
def bracket(tmp_path):
    """Three grey photographs without a chart, and their table."""
    names = [f"frame-{i}.pgm" for i in range(3)]
    samples = np.full((40, 60), 9000, dtype=">u2").tobytes()
    for name in names:
        (tmp_path / name).write_bytes(b"P5\n60 40\n65535\n" + samples)
    table = tmp_path / "bracket.csv"
    table.write_text("\n".join(f"{name},{1000 + 5 * i}" for i, name in enumerate(names)))
    return tmp_path, table


def tilted(bracket, *words, **how):
    folder, table = bracket
    return run("tilt", folder, "--focus", table, *SCREWS, "--out", folder / "out", *words, **how)


@pytest.mark.parametrize(
    ("words", "asked"),
    [
        ((), "--pixel-pitch-um"),
        (("--pixel-pitch-um", 5.0), "--distance-mm and --focal-length-mm"),
        (("--pixel-pitch-um", 5.0, "--positions", "set", "--chart-tilt-deg", 0), "--focal-length-mm"),
        ((*OPTICS[:2], "--positions", "set", "--focal-length-mm", 2000), "beyond the focal length"),
    ],
)
def test_unknown_settings_are_required_first(bracket, words, asked):
    done = tilted(bracket, *words, code=2, says=asked)
    assert "frame-0" not in done.output
    assert not (bracket[0] / "out").exists()


def test_photographs_without_charts_are_refused_and_said_so_in_the_record(bracket):
    done = tilted(bracket, *OPTICS, "--positions", "set", "--json", code=5, says='"refused"')
    assert "no chart" in done.output
