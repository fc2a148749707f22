"""Images for a terminal: a plane as levels, with marks, at any number of cells."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from procedures.plan import Outline, Points
from procedures.raw import Plane

Levels = npt.NDArray[np.uint8]
Array = npt.NDArray[np.float64]

MAX_SIZE = (240, 160)
"""Largest columns and rows of a thumbnail: two pixels per cell of a large terminal."""
RAMP = " .:-=+*#%@"
"""Characters from dark to bright, for terminals without colours."""
OUTLINE_LETTERS = " O+"
"""Characters of the outlines, by their value."""
LEGEND = {False: "orange: now, blue: wanted", True: "O: now, +: wanted"}
LEAST_WHITE = 0.05
"""Lower limit of the white level, so that the noise of a dark frame is not amplified."""
GAMMA = 2.2
SAMPLES_PER_BLOCK = 3
"""Samples per block and direction for its mean; a preview need not read every photosite."""


@dataclass(frozen=True, eq=False)
class Thumbnail:
    """A picture for a terminal.

    levels : (rows, columns) uint8
    marks : points (x, y) as fractions of width and height
    caption : a few words
    outline : the pose to match, in the same fractions
    """

    levels: Levels
    marks: Points = ()
    caption: str = ""
    outline: Outline | None = None


def thumbnail(plane: Plane, marks: Points = (), outline: Outline | None = None) -> Thumbnail:
    """A linear plane gamma-encoded with its brightest parts white; marks and outline are in its pixels."""
    rows, columns = plane.samples.shape
    block = max(1, -(-columns // MAX_SIZE[0]), -(-rows // MAX_SIZE[1]))
    step = max(1, block // SAMPLES_PER_BLOCK)
    sampled = plane.samples[::step, ::step]
    small = shrink(sampled, max(1, rows // block), max(1, columns // block))
    white = max(float(np.percentile(small, 99.5)), LEAST_WHITE)
    levels = np.clip(small / white, 0.0, 1.0) ** (1 / GAMMA) * 255

    def fractions(points: Points) -> Points:
        return tuple(((x + 0.5) / columns, (y + 0.5) / rows) for x, y in points)

    shown = None if outline is None else Outline(fractions(outline.present), fractions(outline.wanted))
    caption = f"plane {plane.name}, {columns} x {rows} pixels"
    return Thumbnail(levels.astype(np.uint8), () if shown else fractions(marks), caption, shown)


def picture_thumbnail(levels: Levels, caption: str) -> Thumbnail:
    """An image whose levels are gamma-encoded."""
    rows, columns = levels.shape
    block = max(1, -(-columns // MAX_SIZE[0]), -(-rows // MAX_SIZE[1]))
    small = shrink(levels, max(1, rows // block), max(1, columns // block))
    return Thumbnail(small.astype(np.uint8), caption=caption)


def psf_thumbnail(h: Array, caption: str) -> Thumbnail:
    """A PSF, its maximum white, negative samples black; the square root makes the tails visible."""
    scaled = np.sqrt(np.clip(h / max(float(h.max()), 1e-300), 0.0, 1.0)) * 255
    return Thumbnail(scaled.astype(np.uint8), caption=caption)


def shrink(picture: npt.NDArray[np.floating] | Levels, rows: int, columns: int) -> Array:
    """The picture on a grid of (rows, columns), each the mean of the block it covers; enlarged by repeating pixels."""
    return _block_means(_block_means(np.asarray(picture, dtype=np.float64), rows).T, columns).T


def _block_means(picture: Array, n: int) -> Array:
    starts = np.arange(n) * len(picture) // n
    ends = np.maximum((np.arange(n) + 1) * len(picture) // n, starts + 1)
    sums = np.concatenate([np.zeros((1, picture.shape[1])), np.cumsum(picture, axis=0)])
    return np.asarray((sums[ends] - sums[starts]) / (ends - starts)[:, None], dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Cells:
    """A thumbnail laid out on a terminal: (2 rows, columns) levels, two to a cell, and the cells that hold a mark.

    lines : like levels: 0, or PRESENT and WANTED on the outlines
    """

    levels: Levels
    marked: frozenset[tuple[int, int]]
    lines: Levels


def lay_out(picture: Thumbnail, width: int, height: int) -> Cells:
    """The thumbnail at its own proportions, as large as `width` x `height` cells take, which are twice as high as wide.
    `marked` holds (row, column) of cells."""
    rows, columns = picture.levels.shape
    scale = min(width / columns, 2 * height / rows)
    across, down = max(1, round(columns * scale)), max(1, round(rows * scale / 2))
    levels = shrink(picture.levels, 2 * down, across).astype(np.uint8)
    inside = [(x, y) for x, y in picture.marks if 0 <= x < 1 and 0 <= y < 1]
    marked = frozenset((int(y * down), int(x * across)) for x, y in inside)
    return Cells(levels, marked, outline_lines(picture.outline, levels.shape))


PRESENT, WANTED = 1, 2
DASH, SLANT = 3, 1.3
"""Length of dashes, and of those of upright lines relative to it: no line lies along the dashes' ends."""


def outline_lines(outline: Outline | None, shape: tuple[int, ...], width: int = 1) -> Levels:
    """The outlines on a grid of this shape: the wanted one dashed, the present one over it."""
    rows, columns = shape
    lines = np.zeros((rows, columns), np.uint8)
    if outline is None:
        return lines
    for points, value in ((outline.wanted, WANTED), (outline.present, PRESENT)):
        if points:
            corners = np.rint(np.array(points) * (columns, rows) - 0.5).clip(-9999, 9999).astype(np.int32)
            drawn = cv2.polylines(np.zeros_like(lines), [corners], True, 1, width).astype(bool)
            if value == WANTED:
                y, x = np.indices(shape)
                drawn &= (x + SLANT * y) // (DASH * width) % 2 == 0
            lines[drawn] = value
    return lines


def in_letters(cells: Cells) -> list[str]:
    """The picture in characters from dark to bright, marks as X."""
    pairs = cells.levels.reshape(-1, 2, cells.levels.shape[1]).mean(axis=1)
    letters = [[RAMP[int(level * len(RAMP) / 256)] for level in row] for row in pairs]
    for row, column in cells.marked:
        letters[row][column] = "X"
    for row, column in zip(*np.nonzero(cells.lines), strict=True):
        letters[row // 2][column] = OUTLINE_LETTERS[cells.lines[row, column]]
    return ["".join(row) for row in letters]
