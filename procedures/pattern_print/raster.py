"""Bitmap of the chart with its white margin, an integer number of pixels per cell, as PNG and PGM without caption."""

from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np
import numpy.typing as npt

from procedures.outcome import BadParameter
from procedures.pattern import BLACK_BLOCKS, BLOCK, BLOCKS, X_CORNER_BLOCKS, Chart, edge_areas
from procedures.pattern_print.sheet import QUIET_BLOCKS, Size
from procedures.pattern_print.source import Source

Bitmap = npt.NDArray[np.uint8]

CELL_PIXELS = 8
EDGE_BLOCKS = 2
"""Blocks of white and black beyond the margin, on the right and below, for slanted edges."""
LARGEST_CELL_PIXELS = 32
PNG_HEADER = 8 + 25
"""Bytes of a PNG's signature and IHDR, after which other chunks may follow."""


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
        image[row * block :, column * block :][:block, :block] = _x_corner(block)
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


def _x_corner(block: int) -> Bitmap:
    """Two triangles in a block of `block` pixels.

    The diagonals bisect the pixels on them. One diagonal is black and the other white, so that the area is exact, and
    the symmetry by half a turn keeps the corner in the centre.
    """
    x = np.arange(block) - (block - 1) / 2
    y = x[:, np.newaxis]
    black = (np.abs(y) > np.abs(x)) | (x == y)
    return np.where(black, 0, 255).astype(np.uint8)


def png(image: Bitmap, source: Source, size: Size) -> bytes:
    """Encode a bitmap as PNG of one bit per pixel, with its resolution, so that it prints at true size."""
    done, encoded = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_BILEVEL, 1])
    if not done:
        raise RuntimeError("OpenCV could not write a PNG")
    data = encoded.tobytes()
    blocks = BLOCKS + 2 * QUIET_BLOCKS + (EDGE_BLOCKS if source.chart.edges else 0)
    per_metre = round(1000 * image.shape[0] / (blocks * BLOCK * size.cell_mm))
    chunks = _chunk(b"pHYs", struct.pack(">IIB", per_metre, per_metre, 1))
    chunks += _chunk(b"tEXt", b"Description\0" + _words(source, size).encode("latin-1"))
    return data[:PNG_HEADER] + chunks + data[PNG_HEADER:]


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def pgm(image: Bitmap, source: Source, size: Size) -> bytes:
    """Encode a bitmap as binary PGM of 8 bits, with the chart's origin and size in a comment."""
    rows, columns = image.shape
    words = _words(source, size).replace("×", "x")
    return f"P5\n# {words}\n{columns} {rows}\n255\n".encode("ascii") + image.tobytes()


def _words(source: Source, size: Size) -> str:
    return f"Noise chart, {source.origin}, {size}, with a white margin of one block"
