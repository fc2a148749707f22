"""Cells of a printed chart, and the description of their origin."""

import hashlib
import re
import struct
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from procedures.outcome import BadInput
from procedures.pattern import CELLS, DEFAULT_SEED, Chart
from procedures.reading.grey_image import LONGEST_HEAD, PNG_MAGIC, TIFF_MAGIC, png_ends, read_tiff
from procedures.reading.guard import decoding, read_file
from procedures.reading.library_noise import captured_noise

GREY_SHARE = 0.01  # greatest share of an image's pixels that are neither black nor white


@dataclass(frozen=True)
class Source:
    """A chart and its origin, "seed 1" or "from image, SHA-256 ..."."""

    chart: Chart
    origin: str

    @classmethod
    def from_seed(cls, seed: int = DEFAULT_SEED) -> "Source":
        return cls(Chart.from_seed(seed), f"seed {seed}")

    def with_edges(self) -> "Source":
        """Chart with two slanted edges added."""
        return replace(self, chart=replace(self.chart, edges=True))

    @classmethod
    def from_file(cls, path: Path) -> "Source":
        """Chart whose cells are the pixels of an image. Raises BadInput if it is no grey file of 256 x 256 pixels,
        black and white."""
        data = read_file(path, "picture of cells")
        image = _decoded(path, data)
        _check_size(path, *image.shape)
        levels = image.astype(np.float64)
        white = levels.max() or 1.0
        grey = float(np.mean((levels > 0.25 * white) & (levels < 0.75 * white)))
        if grey > GREY_SHARE:
            raise BadInput(
                f"cells must be black or white; in {path} {100 * grey:.0f} % of the pixels are grey",
                "give an image of the cells, not a photograph of the chart",
            )
        chart = Chart.from_image(image)
        if chart.cells.min() == chart.cells.max():
            reason = f"a chart must have black and white cells; all of {path} have one colour"
            raise BadInput(reason, "give random cells, half of them white")
        return cls(chart, f"from image, SHA-256 {hashlib.sha256(data).hexdigest()}")


def _decoded(path: Path, data: bytes) -> npt.NDArray[np.generic]:
    """Picture of the right size by its header."""
    if data.startswith(TIFF_MAGIC):
        return read_tiff(data, str(path))[0]
    if data.startswith(PNG_MAGIC) and len(data) > 24:
        _check_size(path, *reversed(struct.unpack_from(">II", data, 16)))
        if not png_ends(data):
            raise BadInput(f"{path} is truncated: the PNG has no end chunk", _REMEDY)
    elif header := _PNM_HEADER.match(data[:LONGEST_HEAD]):
        _check_size(path, int(header["rows"]), int(header["columns"]))
    else:
        raise BadInput(f"{path} is not a readable image", _REMEDY)
    with decoding(str(path), "an image", _REMEDY), captured_noise():
        image: npt.NDArray[np.generic] | None = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise BadInput(f"{path} is not a readable image", _REMEDY)
    return image


_REMEDY = "give a PGM or PNG file"
_GAP = rb"(?:\s|#[^\r\n]*[\r\n])+"
_PNM_HEADER = re.compile(rb"P[1-6]" + _GAP + rb"(?P<columns>\d{1,9})" + _GAP + rb"(?P<rows>\d{1,9})\b")


def _check_size(path: Path, rows: int, columns: int, channels: int = 1) -> None:
    if (rows, columns, channels) != (CELLS, CELLS, 1):
        size = f"{columns} x {rows}" + (f" in {channels} channels" if channels != 1 else "")
        raise BadInput(
            f"the image of the cells must be grey and {CELLS} x {CELLS} pixels; {path} has {size}",
            "give an image with one pixel per cell, without the chart's frame",
        )
