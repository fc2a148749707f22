from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner, Result

from procedures.outcome import BadInput, BadParameter
from procedures.pattern import DEFAULT_SEED, Chart
from procedures.pattern_print.raster import bitmap
from station.cli.pattern import pattern


def _run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(pattern, [str(argument) for argument in arguments])


@pytest.mark.parametrize(
    ("name", "signature"), [("c.pdf", b"%PDF-1"), ("c.SVG", b"<?xml"), ("c.png", b"\x89PNG"), ("c.pgm", b"P5\n")]
)
def test_ending_chooses_the_format(tmp_path: Path, name: str, signature: bytes) -> None:
    assert _run(tmp_path / name).exit_code == 0
    assert (tmp_path / name).read_bytes().startswith(signature)


def test_options_choose_seed_and_pixels(tmp_path: Path) -> None:
    assert _run(tmp_path / "c.pgm", "--seed", "7", "--cell-pixels", "2").exit_code == 0
    written = cv2.imread(str(tmp_path / "c.pgm"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(written, bitmap(Chart.from_seed(7), 2))


def test_bits_choose_the_cells(tmp_path: Path) -> None:
    chart = Chart.from_seed(8)
    cv2.imwrite(str(tmp_path / "bits.pgm"), 255 * chart.cells)
    assert _run(tmp_path / "c.pgm", "--bits", tmp_path / "bits.pgm").exit_code == 0
    written = cv2.imread(str(tmp_path / "c.pgm"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(written, bitmap(chart))


def test_message_names_both_widths_and_the_seed(tmp_path: Path) -> None:
    said = _run(tmp_path / "c.png", "--width-mm", "160").stderr
    assert f"seed {DEFAULT_SEED}" in said
    assert "whole chart 160 mm" in said
    assert "noise 128 mm" in said


def test_seed_and_bits_together_are_refused(tmp_path: Path) -> None:
    done = _run(tmp_path / "c.pdf", "--seed", "1", "--bits", "bits.pgm")
    assert done.exit_code == 2
    assert "both choose the cells" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        (["c.tiff"], BadParameter, r"\.pdf, \.svg, \.png or \.pgm; got c\.tiff"),
        (["c"], BadParameter, "got c"),
        (["c.pdf", "--width-mm", "12"], BadParameter, "32 to 3600 mm"),
        (["c.png", "--cell-pixels", "0"], BadParameter, "1 to 32 pixels"),
        (["c.pdf", "--bits", "bits.pgm"], BadInput, "cannot be read"),
        (["nowhere/c.png"], BadParameter, "cannot be written: No such file or directory"),
        (["file/c.png"], BadParameter, "cannot be written: Not a directory"),
        (["folder.png"], BadParameter, "cannot be written: Is a directory"),
    ],
)
def test_what_cannot_be_done_is_refused_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], error: type[Exception], words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    Path("folder.png").mkdir()
    with pytest.raises(error, match=words):
        CliRunner().invoke(pattern, arguments, catch_exceptions=False)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder.png"]
