"""The tags of a TIFF-like file's image directories, as far as a RAW reader needs them.

LibRaw forgets where a black level was written: it drops repeat patterns other than 2 x 2, replaces the level by the
mean of MaskedAreas, and does not move the pattern when it trims an odd ActiveArea. The tags say what was meant.
Reference: TIFF 6.0, section 2; Adobe DNG 1.6, chapter 4.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Mapping
from typing import BinaryIO, NamedTuple

import numpy as np
import numpy.typing as npt

from procedures.outcome import BadInput

WIDTH, LENGTH = 256, 257
TILE_WIDTH, TILE_LENGTH = 322, 323
SAMPLES_PER_PIXEL = 277
SUB_DIRECTORIES = 330
BITS_PER_SAMPLE = 258
PHOTOMETRIC = 262
WHITE_IS_ZERO = 0
ORIENTATION = 274
CFA = 32803
LINEAR_RAW = 34892
CFA_PATTERN = 33422
DNG_VERSION = 50706
ACTIVE_AREA = 50829
BLACK_REPEAT = 50713
BLACK_LEVEL = 50714
BLACK_DELTA_COLUMNS = 50715
BLACK_DELTA_ROWS = 50716

Tags = Mapping[int, tuple[float, ...]]

WANTED = frozenset((
    WIDTH, LENGTH, TILE_WIDTH, TILE_LENGTH, SAMPLES_PER_PIXEL, SUB_DIRECTORIES, BITS_PER_SAMPLE, PHOTOMETRIC,
    CFA_PATTERN, DNG_VERSION, ACTIVE_AREA, BLACK_REPEAT, BLACK_LEVEL, BLACK_DELTA_COLUMNS, BLACK_DELTA_ROWS,
))  # fmt: skip
"""The tags whose values are read; of the others nothing is."""

# type code -> (struct letter, how many of them make one value)
_KINDS = {1: ("B", 1), 3: ("H", 1), 4: ("I", 1), 5: ("I", 2), 6: ("b", 1), 8: ("h", 1), 9: ("i", 1), 10: ("i", 2),
          11: ("f", 1), 12: ("d", 1), 13: ("I", 1), 16: ("Q", 1)}  # fmt: skip
_TYPES = range(1, 19)
"""Of fields, the makers' additions and BigTIFF's included."""
MOST_DIRECTORIES = 32
"""Cameras write up to ten: the mosaic, previews of some sizes, notes."""
MOST_TAGS = 1000
"""Of one directory. Cameras write up to a hundred; every reader after this one goes through them all."""
MOST_VALUES = 1 << 17
"""Of one tag: a black level for each row of the largest sensor."""


class _Form(NamedTuple):
    """How numbers lie in a file: TIFF's, or BigTIFF's, which counts and points with eight bytes."""

    order: str
    number: str
    pointer: str
    begin: int

    def read(self, file: BinaryIO, letter: str) -> int:
        layout = self.order + letter
        (number,) = struct.unpack(layout, file.read(struct.calcsize(layout)))
        return int(number)


def mosaic_tags(file: BinaryIO, name: str = "the file") -> Tags:
    """The numeric tags of the directory that holds a DNG file's mosaic, or the samples of a sensor without one.

    Empty where there is none to be read.

    Other RAW files are left to LibRaw: their makers use some of the same tags in their own ways. Raises as
    `image_directories`.
    """
    directories = image_directories(file, name)
    if not any(DNG_VERSION in tags for tags in directories):
        return {}
    return next((tags for tags in directories if tags.get(PHOTOMETRIC) == (CFA,) or is_monochrome(tags)), {})


def is_monochrome(tags: Tags) -> bool:
    """Whether these are of a sensor without a mosaic: linear samples, one of each pixel (DNG 1.6, chapter 3)."""
    return tags.get(PHOTOMETRIC) == (LINEAR_RAW,) and tags.get(SAMPLES_PER_PIXEL) == (1,)


def image_directories(file: BinaryIO, name: str = "the file") -> list[Tags]:
    """The `WANTED` tags of every image directory, in the file's order.

    Parameters
    ----------
    file : a seekable binary file
        Any file; what is no TIFF, or a broken one, gives no directories.
    name : str
        The file's, for people.

    Raises
    ------
    BadInput
        If it has more directories, or more tags in one of them, than a photograph has.
    """
    try:
        return _directories(file, name)
    except (struct.error, OSError, OverflowError):
        return []


def has_directory(file: BinaryIO) -> bool:
    """Whether a file has a whole first image directory, which begins with a field of a known type."""
    try:
        form = _form(file)
        if form is None:
            return False
        file.seek(form.read(file, form.pointer))
        size = form.begin * min(form.read(file, form.number), LARGEST_COUNT)
        entries = file.read(size)
    except (struct.error, OSError, OverflowError):
        return False
    return size > 0 and len(entries) == size and struct.unpack(form.order + "H", entries[2:4])[0] in _TYPES


def as_stored(data: bytes) -> bytes:
    """A TIFF file with its first page marked as upright: decoders turn the others as a viewer wants them, and places in
    the frame are the sensor's. Any other file comes back as it is."""
    file = io.BytesIO(data)
    try:
        form = _form(file)
        if form is None:
            return data
        file.seek(form.read(file, form.pointer))
        first = form.read(file, form.number)
        begin, inline = file.tell(), struct.calcsize("<HH" + form.pointer)
        for entry in range(begin, begin + form.begin * min(first, MOST_TAGS), form.begin):
            code, kind = struct.unpack_from(form.order + "HH", data, entry)
            if (code, kind) == (ORIENTATION, 3):
                at = entry + inline
                return data[:at] + struct.pack(form.order + "H", 1) + data[at + 2 :]
    except struct.error:
        pass
    return data


def _form(file: BinaryIO) -> _Form | None:
    """How the file's numbers lie; None where it is no TIFF. The pointer to the first directory is read next."""
    file.seek(0)
    head = file.read(4)
    order = {b"II": "<", b"MM": ">"}.get(head[:2])
    if order is None or len(head) < 4:
        return None
    if struct.unpack(order + "H", head[2:])[0] != BIG:
        return _Form(order, "H", "I", 12)
    return _Form(order, "Q", "Q", 20) if file.read(4) == struct.pack(order + "HH", 8, 0) else None


LARGEST_COUNT = 0xFFFF
"""Tags that a directory of a TIFF can have; a BigTIFF could announce more than there is memory for."""
BIG = 43
"""Version of a BigTIFF."""


def _directories(file: BinaryIO, name: str) -> list[Tags]:
    """All image directories: the chain from the header, and what it refers to as sub-directories."""
    form = _form(file)
    if form is None:
        return []
    waiting = [form.read(file, form.pointer)]
    found: dict[int, Tags] = {}
    while waiting:
        at = waiting.pop(0)
        if at == 0 or at in found:
            continue
        if len(found) == MOST_DIRECTORIES:
            raise BadInput(f"{name} has more than {MOST_DIRECTORIES} image directories", _NO_CAMERA)
        found[at], following = _directory(file, form, at, name)
        waiting += [int(v) for v in found[at].get(SUB_DIRECTORIES, ())[: MOST_DIRECTORIES + 1]] + [following]
    return list(found.values())


_NO_CAMERA = "no camera writes so many; give the file as the camera wrote it"


def _directory(file: BinaryIO, form: _Form, at: int, name: str) -> tuple[Tags, int]:
    """The wanted tags of the directory at an offset, and the offset of the next one."""
    file.seek(at)
    count = form.read(file, form.number)
    if count > MOST_TAGS:
        if form.read(file, "I") >> (16 if form.order == "<" else 0) & 0xFFFF not in _TYPES:
            raise struct.error("no directory is there")
        raise BadInput(f"{name} has an image directory of {count} tags, more than {MOST_TAGS}", _NO_CAMERA)
    entries = file.read(form.begin * count)
    following = form.read(file, form.pointer)
    tags = {}
    for start in range(0, form.begin * count, form.begin):
        code, kind, n = struct.unpack_from(form.order + "HH" + form.pointer, entries, start)
        if code in WANTED and kind in _KINDS and n <= MOST_VALUES:
            inline = struct.calcsize("<HH" + form.pointer)
            tags[code] = _values(file, form, kind, n, entries[start + inline : start + form.begin])
    return tags, following


def _values(file: BinaryIO, form: _Form, kind: int, n: int, field: bytes) -> tuple[float, ...]:
    """The values of one entry, which lie in its last bytes or where these point to."""
    letter, parts = _KINDS[kind]
    layout = f"{form.order}{n * parts}{letter}"
    size = struct.calcsize(layout)
    if size > len(field):
        file.seek(struct.unpack(form.order + form.pointer, field)[0])
        field = file.read(size)
    numbers = struct.unpack(layout, field[:size])
    if parts == 1:
        return numbers
    return tuple(a / b if b else float("nan") for a, b in zip(numbers[::2], numbers[1::2], strict=True))


# --- black levels ------------------------------------------------------------------------------------------------


def written_black(tags: Tags, first: tuple[int, int], shape: tuple[int, int], name: str) -> npt.NDArray[np.float32]:
    """Black level of a mosaic's plane as its tags write it, a number or one per row and column.

    Parameters
    ----------
    tags : of a mosaic, with BLACK_LEVEL among them
    first : [row, column] of the plane's first pixel on the whole sensor
    shape : (rows, columns) of the plane

    Raises
    ------
    BadInput
        If the levels are not as many as they must be, or no numbers.
    """
    top, left = (int(v) for v in (*tags.get(ACTIVE_AREA, ()), 0, 0)[:2])
    row, column = first[0] - top, first[1] - left
    level = np.asarray(_repeated_black(tags, name)[row % 2, column % 2])
    if BLACK_DELTA_ROWS in tags:
        level = level + _delta(tags[BLACK_DELTA_ROWS], row, shape[0], "row", name)[:, None]
    if BLACK_DELTA_COLUMNS in tags:
        level = level + _delta(tags[BLACK_DELTA_COLUMNS], column, shape[1], "column", name)
    if not np.isfinite(level).all():
        raise BadInput(f"{name} writes a black level that is no number", "write its black levels again")
    return level.astype(np.float32)


def written_black_everywhere(
    tags: Tags, first: tuple[int, int], shape: tuple[int, int], name: str
) -> npt.NDArray[np.float32]:
    """The same of every pixel, for a sensor without a mosaic. Raises BadInput."""
    black = np.empty(shape, np.float32)
    for row, column in np.ndindex(2, 2):
        part = black[row::2, column::2]
        part[:] = written_black(tags, (first[0] + row, first[1] + column), (part.shape[0], part.shape[1]), name)
    return black


def _delta(values: tuple[float, ...], first: int, n: int, what: str, name: str) -> npt.NDArray[np.float64]:
    """What each row or column of a plane has more of black than the level itself."""
    chosen = np.array(values[max(first, 0) :: 2][:n], dtype=np.float64)
    if len(chosen) != n:
        reason = f"{name} writes {len(values)} differences of black, which is not one for each {what}"
        raise BadInput(reason, f"write the DNG tag BlackLevelDelta again, with a value for each {what}")
    return chosen


def _repeated_black(tags: Tags, name: str) -> npt.NDArray[np.float64]:
    """The BlackLevel pattern as (2, 2), by position in the active area."""
    rows, columns = (int(v) for v in (*tags.get(BLACK_REPEAT, ()), 1, 1)[:2])
    levels = np.array(tags[BLACK_LEVEL], dtype=np.float64)
    if levels.size != rows * columns or not levels.size:
        reason = f"{name} writes {levels.size} black levels for a repeat pattern of {rows} x {columns}"
        raise BadInput(reason, "write it again with the DNG tag BlackLevelRepeatDim, or with one black level")
    if np.ptp(levels) == 0:
        return np.full((2, 2), levels[0])
    if 2 % rows or 2 % columns:
        reason = f"black has to be one level per plane; {name} repeats it every {rows} x {columns} pixels"
        raise BadInput(reason, "write it again with one black level for each position of the 2 x 2 mosaic")
    return np.tile(levels.reshape(rows, columns), (2 // rows, 2 // columns))
