"""Pictures in the pixels of a terminal that reports sixel or kitty graphics; others get block characters.

Sources: DEC STD 070 chapter 14 (sixel), the kitty graphics protocol with Unicode placeholders.
"""

import base64
import unicodedata
import zlib
from collections.abc import Iterator

import cv2
import numpy as np
import numpy.typing as npt

from station.app.terminal_images import PRESENT, Thumbnail, outline_lines

Pixels = npt.NDArray[np.uint8]
GREYS = 24
COLOURS = ((230, 126, 34), (52, 172, 224))
"""Colours of the present and the wanted outline, as in block characters."""
LINE_PX, ARROW_TIP = 3, 0.15
MAX_PX = 640
"""Largest width of a picture in pixels, lest a slow line take seconds."""


def fitted(picture: Thumbnail, width: int, height: int, cell: tuple[int, int]) -> tuple[int, int]:
    """Columns and rows of cells that the picture takes within an area of cells, in its own proportions."""
    rows, columns = picture.levels.shape
    scale = min(width * cell[0] / columns, height * cell[1] / rows, MAX_PX / columns)
    return max(1, round(columns * scale / cell[0])), max(1, int(rows * scale / cell[1]))


def indexed(picture: Thumbnail, width_px: int, height_px: int) -> Pixels:
    """The picture as indices of greys and of the colours of outlines; an arrow leads to the wanted place."""
    large = cv2.resize(picture.levels, (width_px, height_px), interpolation=cv2.INTER_AREA)
    indices = (large.astype(int) * GREYS // 256).astype(np.uint8)
    lines = outline_lines(picture.outline, indices.shape, LINE_PX)
    if picture.outline is not None and picture.outline.present:
        size = np.array([width_px, height_px])
        start = np.mean(picture.outline.present, axis=0) * size
        end = start + np.array(picture.outline.arrow) * size
        if np.hypot(*(end - start)) > 3 * LINE_PX:
            a, b = (tuple(int(v) for v in point) for point in (start, end))
            cv2.arrowedLine(lines, a, b, PRESENT, LINE_PX, tipLength=ARROW_TIP)
    indices[lines > 0] = GREYS - 1 + lines[lines > 0]
    return indices


def palette() -> Pixels:
    """The colours (n, 3) of the indices."""
    greys = np.repeat(np.linspace(0, 255, GREYS)[:, None], 3, axis=1)
    return np.asarray(np.rint(np.vstack([greys, COLOURS])), dtype=np.uint8)


def sixel(indices: Pixels) -> str:
    """A picture of palette indices as sixels: bands of six rows, in each the pixels of one colour after another."""
    rows, columns = indices.shape
    colours = "".join(
        f"#{i};2;{r};{g};{b}" for i, (r, g, b) in enumerate(np.rint(palette() * (100 / 255)).astype(int).tolist())
    )
    padded = np.pad(indices.astype(np.int16), ((0, -rows % 6), (0, 0)), constant_values=-1)
    bands = "-".join("$".join(_band(band)) for band in padded.reshape(-1, 6, columns))
    return f'\x1bP0;1q"1;1;{columns};{rows}{colours}{bands}\x1b\\'


def _band(band: npt.NDArray[np.int16]) -> Iterator[str]:
    """The sixels of every colour of a band, equal ones counted."""
    for colour in np.unique(band[band >= 0]).tolist():
        bits = ((band == colour) << np.arange(6)[:, None]).sum(axis=0)
        ends = np.flatnonzero(np.diff(bits, append=-1)) + 1
        counts = np.diff(ends, prepend=0)
        runs = (chr(63 + bit) * n if n < 4 else f"!{n}{chr(63 + bit)}"
                for bit, n in zip(bits[ends - 1].tolist(), counts.tolist(), strict=True))  # fmt: skip
        yield f"#{colour}{''.join(runs)}"


PLACEHOLDER = "\U0010eeee"
COMPOSING = {*range(0x300, 0x305), *range(0x306, 0x30D), 0x30F, 0x311, 0x313, 0x314, 0x342}
ROW_MARKS = tuple(
    chr(c) for c in range(0x305, 0x5C5)
    if unicodedata.combining(chr(c)) == 230 and not unicodedata.decomposition(chr(c)) and c not in COMPOSING
)  # fmt: skip
"""Combining characters that number rows and columns: those above a letter that compose no other letter."""
CHUNK = 4096


def kitty(indices: Pixels, number: int, columns: int, rows: int) -> str:
    """A picture sent to the terminal under a number, to be drawn at placeholders over columns x rows cells."""
    data = base64.standard_b64encode(zlib.compress(palette()[indices].tobytes())).decode()
    head = f"a=T,U=1,q=2,f=24,o=z,i={number},s={indices.shape[1]},v={indices.shape[0]},c={columns},r={rows}"
    parts = [data[i : i + CHUNK] for i in range(0, len(data), CHUNK)]
    keys = [f"{head if i == 0 else 'q=2'},m={int(i < len(parts) - 1)}" for i in range(len(parts))]
    return "".join(f"\x1b_G{key};{part}\x1b\\" for key, part in zip(keys, parts, strict=True))


def placeholders(columns: int, rows: int) -> list[str]:
    """The lines of placeholders at which the picture is drawn; the colour of the text is its number."""
    marks = ROW_MARKS[:rows]
    return [f"{PLACEHOLDER}{mark}{ROW_MARKS[0]}{f'{PLACEHOLDER}{mark}' * (columns - 1)}" for mark in marks]


def at_cell(x: int, y: int, text: str) -> str:
    """A text at a cell (from 0), the cursor kept."""
    return f"\x1b7\x1b[{y + 1};{x + 1}H{text}\x1b8"
