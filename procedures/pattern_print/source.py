"""Which cells are printed, and the words that let anyone find them again."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from procedures.outcome import BadInput
from procedures.pattern import CELLS, DEFAULT_SEED, Chart

GREY_SHARE = 0.01
"""Largest share of an image's pixels that may be neither black nor white: a few damaged ones, no photograph."""


@dataclass(frozen=True)
class Source:
    """A chart, and its origin as it is printed: "seed 1", or "from image, SHA-256 ..." of the file."""

    chart: Chart
    origin: str

    @classmethod
    def from_seed(cls, seed: int = DEFAULT_SEED) -> Source:
        """The chart of a seed."""
        return cls(Chart.from_seed(seed), f"seed {seed}")

    def with_edges(self) -> Source:
        """The same chart with two slanted edges beside it."""
        return replace(self, chart=replace(self.chart, edges=True))

    @classmethod
    def from_file(cls, path: Path) -> Source:
        """The chart whose cells are the pixels of a 256 x 256 black and white image.

        Raises
        ------
        BadInput
            If the file cannot be read as a grey image of that size, is not black and white, or has one colour only.
        """
        try:
            data = path.read_bytes()
        except OSError as error:
            raise BadInput(f"{path} cannot be read: {error.strerror}", "give a file that exists") from error
        chart = Chart.from_image(_black_and_white(path, data))
        if chart.cells.min() == chart.cells.max():
            raise BadInput(f"all cells of {path} have one colour", "give random cells, half of them white")
        return cls(chart, f"from image, SHA-256 {hashlib.sha256(data).hexdigest()}")


def _black_and_white(path: Path, data: bytes) -> npt.NDArray[np.generic]:
    image = _decoded(path, data)
    if image.shape != (CELLS, CELLS):
        raise BadInput(
            f"the cells come from a grey image of {CELLS} x {CELLS} pixels; {path} has {_size(image)}",
            "give one pixel per cell, without the chart's frame",
        )
    levels = image.astype(np.float64)
    white = levels.max() or 1.0
    grey = float(np.mean((levels > 0.25 * white) & (levels < 0.75 * white)))
    if grey > GREY_SHARE:
        raise BadInput(
            f"a cell is black or white; in {path} {100 * grey:.0f} % of the pixels are grey",
            "give the cells themselves, not a photograph of them",
        )
    return image


def _decoded(path: Path, data: bytes) -> npt.NDArray[np.generic]:
    # an empty buffer is an exception in OpenCV, any other nonsense a None
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    if image is None:
        raise BadInput(f"{path} is no image that can be read", "give a PGM or PNG file")
    return image


def _size(image: npt.NDArray[np.generic]) -> str:
    height, width, *channels = image.shape
    return f"{width} x {height}" + (f" in {channels[0]} channels" if channels else "")
