from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from procedures.outcome import BadInput, BadParameter
from procedures.pattern import DEFAULT_SEED, Chart
from procedures.pattern_print.formats import bitmap
from station.cli.pattern import pattern
from tests.program import run

_run = partial(run, "pattern")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "signature"), [("c.pdf", b"%PDF-1"), ("c.SVG", b"<?xml"), ("c.png", b"\x89PNG"), ("c.pgm", b"P5\n")]
)
def test_ending_chooses_the_format(tmp_path: Path, name: str, signature: bytes) -> None:
    _run(tmp_path / name)
    assert (tmp_path / name).read_bytes().startswith(signature)


def test_options_choose_seed_and_pixels(tmp_path: Path) -> None:
    _run(tmp_path / "c.pgm", "--seed", "7", "--cell-pixels", "2")
    written = cv2.imread(str(tmp_path / "c.pgm"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(written, bitmap(Chart.from_seed(7), 2))


def test_bits_choose_the_cells(tmp_path: Path) -> None:
    chart = Chart.from_seed(8)
    cv2.imwrite(str(tmp_path / "bits.pgm"), 255 * chart.cells)
    _run(tmp_path / "c.pgm", "--bits", tmp_path / "bits.pgm")
    written = cv2.imread(str(tmp_path / "c.pgm"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(written, bitmap(chart))


@pytest.mark.parametrize(
    ("locale", "arguments", "words"),
    [
        ("de_DE.UTF-8", [], "A4, 210 × 297 mm; seed 1; whole chart 145 mm"),
        ("en_US.UTF-8", [], "Letter, 215.9 × 279.4 mm; seed 1; whole chart 130 mm"),
        ("en_US.UTF-8", ["--paper", "A4"], "A4, 210 × 297 mm; seed 1; whole chart 145 mm"),
        ("de_DE.UTF-8", ["--paper", "a3", "--width-mm", "100"], "A3, 297 × 420 mm; seed 1; whole chart 100 mm"),
        ("de_DE.UTF-8", ["--width-mm", "300"], "A2, 420 × 594 mm; seed 1; whole chart 300 mm"),
        ("en_US.UTF-8", ["--width-mm", "170"], "Legal, 215.9 × 355.6 mm; seed 1; whole chart 170 mm"),
        ("en_US.UTF-8", ["--width-mm", "300"], "A2, 420 × 594 mm; seed 1; whole chart 300 mm"),
        ("de_DE.UTF-8", ["--tile"], "2 × 2 sheets of A4 after an assembly drawing; seed 1; whole chart 300 mm"),
        ("de_DE.UTF-8", ["--tile", "--width-mm", "120"], "A4, 210 × 297 mm; seed 1; whole chart 120 mm"),
    ],
)
def test_paper_and_width_follow_from_each_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, locale: str, arguments: list[str], words: str
) -> None:
    monkeypatch.setenv("LC_ALL", locale)
    assert words in _run(tmp_path / "c.pdf", *arguments).stderr


def test_message_names_both_widths_and_the_seed(tmp_path: Path) -> None:
    message = _run(tmp_path / "c.png", "--width-mm", "160").stderr
    assert f"seed {DEFAULT_SEED}" in message
    assert "whole chart 160 mm" in message
    assert "noise 128 mm" in message


@pytest.mark.slow
def test_a_given_lens_lists_the_noise_amplification_by_distance(tmp_path: Path) -> None:
    lens = ("--focal-length-mm", "50", "--pixel-pitch-um", "4")
    output = _run(tmp_path / "c.pgm", *lens, "--f-number", "8").stderr
    rows = [line.split() for line in output.splitlines()]
    (least,) = (row for row in rows if row[::2][:2] == ["1.3", "m"])
    # by a thin lens: z = f (1 + cell / (pixels per cell x pitch)), 50 (1 + 0.453125 / (1.3 / 4 x 0.008)) mm
    assert least[1:5] == ["8.76", "m", "83", "px"]
    (far,) = (row for row in rows if row[::2][:2] == ["0.7", "m"])
    assert float(far[5]) > 4 * float(least[5])
    assert "The cutoff of f/8 is 1.89 cycles/pixel" in " ".join(output.split())
    grey = _run(tmp_path / "c.pgm", *lens, "--monochrome").stderr
    (twice,) = (line.split() for line in grey.splitlines() if line.split()[::2][:2] == ["1.3", "m"])
    assert float(twice[1]) == pytest.approx(2 * 8.764 - 0.05, abs=0.01)


@pytest.mark.parametrize(
    ("words", "message"),
    [(("--focal-length-mm", "50"), "together"), (("--seed", "1", "--bits", "bits.pgm"), "both define the cells")],
)
def test_incompatible_options_are_refused(tmp_path: Path, words: tuple[str, ...], message: str) -> None:
    _run(tmp_path / "c.pdf", *words, code=2, says=message)


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        (["c.tiff"], BadParameter, r"\.pdf, \.svg, \.png or \.pgm; got c\.tiff"),
        (["c"], BadParameter, "got c"),
        (["c.pdf", "--width-mm", "12"], BadParameter, "32 to 3600 mm"),
        (["c.pdf", "--width-mm", "0"], BadParameter, "32 to 3600 mm"),
        (["c.pdf", "--paper", "a4", "--width-mm", "146"], BadParameter, "A4 must be at most 145 mm wide; got 146 mm"),
        (["c.png", "--paper", "a4", "--width-mm", "146"], BadParameter, "A4 must be at most 145 mm wide; got 146 mm"),
        (["c.svg", "--tile"], BadParameter, r"several sheets must be \.pdf; got c\.svg"),
        (["c.pdf", "--tile", "--edges"], BadParameter, "slanted edges must fit on one sheet"),
        (["c.png", "--cell-pixels", "0"], BadParameter, "1 to 32 pixels"),
        (["c.pdf", "--bits", "bits.pgm"], BadInput, "there is no file"),
        (["nowhere/c.png"], BadParameter, "cannot be written: No such file or directory"),
        (["file/c.png"], BadParameter, "cannot be written: Not a directory"),
        (["folder.png"], BadParameter, "cannot be written: Is a directory"),
    ],
)
def test_invalid_requests_are_refused_and_leave_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], error: type[Exception], words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    Path("folder.png").mkdir()
    with pytest.raises(error, match=words):
        CliRunner().invoke(pattern, arguments, catch_exceptions=False)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder.png"]
