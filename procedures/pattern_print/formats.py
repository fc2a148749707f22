"""Encoding of the chart as a file, by its suffix."""

import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
import numpy.typing as npt
from reportlab.lib.units import mm
from reportlab.pdfgen.canvas import Canvas

from procedures.outcome import BadParameter
from procedures.pattern import BLACK_BLOCKS, BLOCK, BLOCKS, X_CORNER_BLOCKS, Chart, edge_areas
from procedures.pattern_print.panel import BOLD_FONT, FONT, Text
from procedures.pattern_print.sheet import QUIET_BLOCKS, Loop, Paper, Sheet, Size, check_fits, lay_out
from procedures.pattern_print.source import Source
from procedures.pattern_print.tile_sheets import tiled, tiling_of

PDF_DRAW = {"start": "drawString", "middle": "drawCentredString", "end": "drawRightString"}


def pdf(*sheets: Sheet) -> bytes:
    """Encode the sheets as a PDF with a page for each; equal sheets give equal bytes."""
    file = io.BytesIO()
    # invariant: no date and no random identifier
    canvas = Canvas(file, invariant=1)
    canvas.setTitle(sheets[0].title)
    canvas.setSubject("Print at 100 %, without scaling or smoothing")
    canvas.setCreator("calibration-station")
    canvas.setViewerPreference("PrintScaling", "None")
    canvas.setViewerPreference("Duplex", "Simplex")
    for sheet in sheets:
        canvas.setPageSize((sheet.width_mm * mm, sheet.height_mm * mm))
        _pdf_chart(canvas, sheet)
        for stroke in sheet.caption.strokes:
            (x0, y0), (x1, y1) = stroke.start, stroke.end
            canvas.setLineWidth(stroke.thickness * mm)
            canvas.line(x0 * mm, (sheet.height_mm - y0) * mm, x1 * mm, (sheet.height_mm - y1) * mm)
        for text in sheet.caption.texts:
            canvas.setFont(BOLD_FONT if text.bold else FONT, text.size * mm)
            getattr(canvas, PDF_DRAW[text.anchor])(text.x * mm, (sheet.height_mm - text.y) * mm, text.words)
        canvas.showPage()
    canvas.save()
    return file.getvalue()


def _pdf_chart(canvas: Canvas, sheet: Sheet) -> None:
    x, y = sheet.noise_corner_mm
    cell = sheet.size.cell_mm * mm
    canvas.saveState()
    if sheet.window_mm is not None:
        left, top, right, bottom = (end * mm for end in sheet.window_mm)
        clip = canvas.beginPath()
        clip.rect(left, sheet.height_mm * mm - bottom, right - left, bottom - top)
        canvas.clipPath(clip, stroke=0)
    # unit of one cell, y down: the path consists of integers
    canvas.transform(cell, 0, 0, -cell, x * mm, (sheet.height_mm - y) * mm)
    # literal, as the canvas would format each of 50 000 integers as a length, which takes 0.25 s
    operators = ["n"]
    for (x0, y0), *others in sheet.visible_outlines():
        operators += [f"{x0} {y0} m", *(f"{a} {b} l" for a, b in others), "h"]
    canvas.addLiteral(" ".join([*operators, "f*"]))
    canvas.restoreState()


def svg(sheet: Sheet) -> bytes:
    """Encode a sheet as SVG with `viewBox` in mm, so that one unit is one millimetre."""
    width, height = f"{sheet.width_mm:.6g}", f"{sheet.height_mm:.6g}"
    x, y = sheet.noise_corner_mm
    place = f"translate({x:.9g} {y:.9g}) scale({sheet.size.cell_mm:.9g})"
    extent = f'width="{width}mm" height="{height}mm" viewBox="0 0 {width} {height}"'
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" {extent}>',
        f"<title>{escape(sheet.title)}</title>",
        f'<rect width="{width}" height="{height}" fill="#fff"/>',
        f'<path id="chart" fill="#000" transform="{place}" d="{"".join(map(_svg_loop, sheet.black))}"/>',
        *_svg_caption(sheet),
        "</svg>\n",
    ]
    return "\n".join(lines).encode()


def _svg_loop(loop: Loop) -> str:
    """SVG path of a loop, with relative steps from a corner."""
    x, y = loop[0]
    return f"M{x} {y}" + "".join(_svg_step(x1 - x0, y1 - y0) for (x0, y0), (x1, y1) in pairwise(loop)) + "z"


def _svg_step(dx: int, dy: int) -> str:
    if dy == 0:
        return f"h{dx}"
    return f"v{dy}" if dx == 0 else f"l{dx} {dy}"


def _svg_caption(sheet: Sheet) -> Iterator[str]:
    yield '<g id="lines" stroke="#000">'
    for stroke in sheet.caption.strokes:
        (x0, y0), (x1, y1) = stroke.start, stroke.end
        ends = f'x1="{x0:.6f}" y1="{y0:.6f}" x2="{x1:.6f}" y2="{y1:.6f}"'
        yield f'<line {ends} stroke-width="{stroke.thickness:.4f}"/>'
    yield '</g>\n<g id="texts" font-family="Helvetica, Arial, sans-serif">'
    yield from map(_svg_text, sheet.caption.texts)
    yield "</g>"


def _svg_text(text: Text) -> str:
    weight = ' font-weight="bold"' if text.bold else ""
    anchor = "" if text.anchor == "start" else f' text-anchor="{text.anchor}"'
    place = f'x="{text.x:.4f}" y="{text.y:.4f}" font-size="{text.size:.4f}"'
    return f"<text {place}{weight}{anchor}>{escape(text.words)}</text>"


Bitmap = npt.NDArray[np.uint8]

CELL_PIXELS = 8
EDGE_BLOCKS = 2  # blocks of white and black beyond the margin, on the right and below, for slanted edges
LARGEST_CELL_PIXELS = 32


def bitmap(chart: Chart, cell_pixels: int = CELL_PIXELS) -> Bitmap:
    """Bitmap (384 cell_pixels, 384 cell_pixels) of the chart in its margin of one block, white 255 and black 0.

    With slanted edges it has two more blocks on the right and below. Raises BadParameter if `cell_pixels` is not 1 to
    32.
    """
    if not 1 <= cell_pixels <= LARGEST_CELL_PIXELS:
        raise BadParameter(
            f"a cell must have 1 to {LARGEST_CELL_PIXELS} pixels; got {cell_pixels}", "use a PDF for a finer print"
        )
    block = BLOCK * cell_pixels
    image = np.full((block * BLOCKS, block * BLOCKS), 255, dtype=np.uint8)
    image[block:-block, block:-block] = 255 * chart.cells.repeat(cell_pixels, axis=0).repeat(cell_pixels, axis=1)
    for column, row in BLACK_BLOCKS:
        image[row * block :, column * block :][:block, :block] = 0
    for column, row in X_CORNER_BLOCKS:
        # two triangles in a block of `block` pixels, one diagonal black and the other white: exact area, and a centred
        # corner
        x = np.arange(block) - (block - 1) / 2
        y = x[:, np.newaxis]
        black = (np.abs(y) > np.abs(x)) | (x == y)
        image[row * block :, column * block :][:block, :block] = np.where(black, 0, 255).astype(np.uint8)
    beyond = QUIET_BLOCKS + (EDGE_BLOCKS if chart.edges else 0)
    image = np.pad(image, (QUIET_BLOCKS * block, beyond * block), constant_values=255)
    return _with_edges(image, cell_pixels) if chart.edges else image


def _with_edges(image: Bitmap, cell_pixels: int) -> Bitmap:
    """Add the black areas of the slanted edges: pixels whose centres lie in them."""
    first = BLOCK * (1 + QUIET_BLOCKS)
    for area in edge_areas():
        corners = (area + first) * cell_pixels - 0.5
        (x0, y0), (x1, y1) = np.floor(corners.min(axis=0)).astype(int), np.ceil(corners.max(axis=0)).astype(int) + 1
        x, y = np.meshgrid(np.arange(x0, x1), np.arange(y0, y1))
        inside = np.ones(x.shape, dtype=np.bool_)
        for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            inside &= (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0
        image[y0:y1, x0:x1][inside] = 0
    return image


def png(image: Bitmap, source: Source, size: Size) -> bytes:
    """Encode a bitmap as PNG of one bit per pixel, with its resolution, so that it prints at true size."""
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    blocks = BLOCKS + 2 * QUIET_BLOCKS + (EDGE_BLOCKS if source.chart.edges else 0)
    per_inch = 25.4 * image.shape[0] / (blocks * BLOCK * size.cell_mm)
    file, words = io.BytesIO(), PngInfo()
    words.add_text("Description", _words(source, size))
    Image.fromarray(image > 0).save(file, "PNG", dpi=(per_inch, per_inch), pnginfo=words)
    return file.getvalue()


def pgm(image: Bitmap, source: Source, size: Size) -> bytes:
    """Encode a bitmap as binary PGM of 8 bits, with the chart's origin and size in a comment."""
    rows, columns = image.shape
    words = _words(source, size).replace("×", "x")
    return f"P5\n# {words}\n{columns} {rows}\n255\n".encode("ascii") + image.tobytes()


def _words(source: Source, size: Size) -> str:
    return f"Noise chart, {source.origin}, {size}, with a white margin of one block"


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
    path: Path, source: Source, size: Size, cell_pixels: int = CELL_PIXELS, paper: Paper | None = None, *,
    tile: bool = False,
) -> Encoded:  # fmt: skip
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
