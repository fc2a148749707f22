"""The chart as the bytes of a file, by the file's ending."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from procedures.outcome import BadParameter
from procedures.pattern_print.paper import Paper
from procedures.pattern_print.raster import CELL_PIXELS, bitmap, pgm, png
from procedures.pattern_print.sheet import Sheet, Size, check_fits, lay_out
from procedures.pattern_print.source import Source
from procedures.pattern_print.tile_sheets import tiled
from procedures.pattern_print.tiles import tiling_of
from procedures.pattern_print.vector import pdf, svg

PAGES: dict[str, Callable[[Sheet], bytes]] = {".pdf": pdf, ".svg": svg}
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


def encode(
    path: Path,
    source: Source,
    size: Size,
    cell_pixels: int = CELL_PIXELS,
    paper: Paper | None = None,
    *,
    tile: bool = False,
) -> Encoded:
    """What to write into the file: a page with caption and rulers for .pdf and .svg, pixels for .png and .pgm.

    `paper` is the one it shall be printed on; with `tile` over several sheets, a page for each, where one does not
    hold the chart.

    Raises
    ------
    BadParameter
        If the paper does not hold the chart; with `tile`, if the file is no PDF, the chart has slanted edges, or it
        takes too many sheets.
    """
    ending, edges = check_ending(path), source.chart.edges
    if tile and paper is not None and not size.fits(paper, edges):
        if ending != ".pdf":
            raise BadParameter(
                f"a chart over several sheets is written as .pdf, a page for each; got {path.name}",
                f"name the file {path.stem}.pdf, or order a chart that fits on one sheet",
            )
        tiling = tiling_of(size, paper)
        return Encoded(pdf(*tiled(source, tiling)), f"{tiling}")
    if ending in PAGES:
        sheet = lay_out(source, size, paper)
        return Encoded(PAGES[ending](sheet), f"{sheet}")
    if paper is not None:
        check_fits(size, paper, edges)
    image = bitmap(source.chart, cell_pixels)
    rows, columns = image.shape
    return Encoded(IMAGES[ending](image, source, size), f"{columns} × {rows} pixels")
