"""The chart as the bytes of a file, by the file's ending."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from procedures.outcome import BadParameter
from procedures.pattern_print.raster import CELL_PIXELS, bitmap, pgm, png
from procedures.pattern_print.sheet import Size, lay_out
from procedures.pattern_print.source import Source
from procedures.pattern_print.vector import pdf, svg

PAGES = {".pdf": pdf, ".svg": svg}
IMAGES = {".png": png, ".pgm": pgm}


def check_ending(path: Path) -> str:
    """The file's ending, in lower case.

    Raises
    ------
    BadParameter
        If no chart can be written as that.
    """
    ending = path.suffix.lower()
    if ending not in PAGES | IMAGES:
        raise BadParameter(
            f"the chart is written as .pdf, .svg, .png or .pgm; got {path.name}",
            "name the file with one of these endings",
        )
    return ending


@dataclass(frozen=True)
class Encoded:
    """A file's bytes, and its extent in words: the paper of a page, the pixels of an image."""

    data: bytes
    extent: str


def encode(path: Path, source: Source, size: Size, cell_pixels: int = CELL_PIXELS) -> Encoded:
    """What to write into the file: a page with caption and rulers for .pdf and .svg, pixels for .png and .pgm."""
    ending = check_ending(path)
    if ending in PAGES:
        sheet = lay_out(source, size)
        return Encoded(PAGES[ending](sheet), f"{sheet}")
    image = bitmap(source.chart, cell_pixels)
    rows, columns = image.shape
    return Encoded(IMAGES[ending](image, source, size), f"{columns} × {rows} pixels")
