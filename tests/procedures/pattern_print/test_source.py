import hashlib
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from procedures.outcome import BadInput
from procedures.pattern import CELLS
from procedures.pattern_print.source import Source


def _saved(path: Path, image: npt.NDArray[np.uint8] | npt.NDArray[np.uint16]) -> Path:
    assert cv2.imwrite(str(path), image)
    return path


def _cells(rng: np.random.Generator) -> npt.NDArray[np.uint8]:
    return rng.integers(0, 2, (CELLS, CELLS), dtype=np.uint8)


def test_published_cells_are_read(shared_data: Path) -> None:
    path = shared_data / "pattern_photo" / "pattern_noise.pgm"
    source = Source.from_file(path)
    assert source.origin == f"from image, SHA-256 {hashlib.sha256(path.read_bytes()).hexdigest()}"
    np.testing.assert_array_equal(source.chart.cells == 1, cv2.imread(str(path), cv2.IMREAD_UNCHANGED) == 255)


@pytest.mark.parametrize("name", ["bits.pgm", "bits.png"])
def test_image_of_black_and_white_gives_its_cells(rng: np.random.Generator, tmp_path: Path, name: str) -> None:
    cells = _cells(rng)
    np.testing.assert_array_equal(Source.from_file(_saved(tmp_path / name, 255 * cells)).chart.cells, cells)


def test_sixteen_bit_image_gives_its_cells(rng: np.random.Generator, tmp_path: Path) -> None:
    cells = _cells(rng)
    path = _saved(tmp_path / "bits.png", cells * np.uint16(65535))
    np.testing.assert_array_equal(Source.from_file(path).chart.cells, cells)


def test_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="there is no file"):
        Source.from_file(tmp_path / "bits.pgm")


@pytest.mark.parametrize("data", [b"", b"cells, said the file", b"P5\n256 256\n255\n"])
def test_file_that_is_no_image_is_refused(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "bits.pgm").write_bytes(data)
    with pytest.raises(BadInput, match="not a readable image"):
        Source.from_file(tmp_path / "bits.pgm")


GREY = np.random.default_rng(1).integers(0, 256, (CELLS, CELLS), dtype=np.uint8)


@pytest.mark.parametrize(
    ("name", "image", "reason"),
    [
        ("bits.pgm", np.zeros((255, 256), np.uint8), r"256 x 256 pixels; .* has 256 x 255"),
        ("bits.png", np.zeros((CELLS, CELLS, 3), np.uint8), "256 x 256 in 3 channels"),
        ("bits.pgm", GREY, r"black or white; .* 50 % of the pixels are grey"),
        ("bits.pgm", np.zeros((CELLS, CELLS), np.uint8), "one colour"),
        ("bits.pgm", np.full((CELLS, CELLS), 255, np.uint8), "one colour"),
    ],
)
def test_other_images_are_refused(tmp_path: Path, name: str, image: npt.NDArray[np.uint8], reason: str) -> None:
    path = _saved(tmp_path / name, image)
    with pytest.raises(BadInput, match=reason):
        Source.from_file(path)
