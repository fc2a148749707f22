"""Encoding of the chart as a file, by its suffix."""

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
    """Suffix of the file in lower case. Raises BadParameter if the suffix is not supported."""
    ending = path.suffix.lower()
    if ending not in PAGES | IMAGES:
        raise BadParameter(
            f"the file of a chart must be .pdf, .svg, .png or .pgm; got {path.name}", "use one of these suffixes"
        )
    return ending


@dataclass(frozen=True)
class Encoded:
    """Content of a file, and its extent in words: the paper of a page, the pixels of an image."""

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
    """Encode a chart: a page with caption and rulers for .pdf and .svg, pixels for .png and .pgm.

    `paper` is the paper of the printer; with `tile` a chart that does not fit is divided into several sheets, a page
    for each. Raises BadParameter if the chart does not fit on the paper; with `tile`, if the file is not a PDF, the
    chart has slanted edges, or too many sheets are required.
    """
    ending, edges = check_ending(path), source.chart.edges
    if tile and paper is not None and not size.fits(paper, edges):
        if ending != ".pdf":
            raise BadParameter(
                f"the file of a chart on several sheets must be .pdf; got {path.name}",
                f"name it {path.stem}.pdf, or choose a chart that fits on one sheet",
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
