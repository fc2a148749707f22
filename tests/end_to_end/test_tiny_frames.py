"""Photographs of a few pixels end every command with a stated refusal."""

import click
import numpy as np
import pytest

from tests.program import run

SIZES = [(1, 1), (1, 5), (64, 1), (2, 2), (3, 3)]
COMMANDS = {
    "sensor": "sensor . --no-report",
    "vignetting": "vignetting 4.pgm",
    "pattern": "psf pattern 4.pgm",
    "two-photo": "psf two-photo 4.pgm 6.pgm",
    "field": "psf field .",
    "edge": "mtf edge 4.pgm",
    "restore": "restore 4.pgm 6.pgm --blur motion --shape a.txt b.txt",
    "flat": "restore 4.pgm 6.pgm --blur motion --prototype-region whole",
    "geometry": "geometry 4.pgm 6.pgm",
}


# processes begin for each geometry, which takes a second
@pytest.mark.parametrize(
    ("size", "command"),
    [(size, name) for size in SIZES for name in COMMANDS if name != "geometry" or size in (SIZES[0], SIZES[-1])],
    ids=str,
)
def test_tiny_photographs_are_refused(size, command, tmp_path, monkeypatch):
    """Pictures of two dark levels and six lit ones, two of each, of so many columns and rows."""
    (columns, rows), rng = size, np.random.default_rng(1)
    lines = ["file,kind,exposure_s,photons"]
    for n in range(14):
        light = 4000.0 * (n // 2)
        levels = np.clip(rng.normal(600 + light, 5 + light**0.5, (rows, columns)), 0, 65535).astype(">u2")
        (tmp_path / f"{n}.pgm").write_bytes(b"P5 %d %d 65535\n" % (columns, rows) + levels.tobytes())
        lines.append(f"{n}.pgm,light,0.01,{light}" if light else f"{n}.pgm,dark,0.01,")
    (tmp_path / "sensor.csv").write_text("\n".join(lines) + "\n")
    (tmp_path / "a.txt").write_text("0 1 0\n1 2 1\n0 1 0\n")
    (tmp_path / "b.txt").write_text("0 1 0\n0 2 0\n0 1 0\n")
    monkeypatch.chdir(tmp_path)
    done = run(*COMMANDS[command].split(), "--out", "out", code=None)
    assert isinstance(done.exception, SystemExit | click.exceptions.Exit)
    assert done.exit_code in (2, 4, 5), done.output
