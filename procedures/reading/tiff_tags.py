"""Tags of the image directories of TIFF-like files that are required for reading RAW data.

LibRaw does not preserve black levels: it drops repeat patterns other than 2 x 2, replaces the level by the mean of
MaskedAreas, and does not move the pattern when it trims an odd ActiveArea. The tags have the original levels.
Reference: TIFF 6.0, section 2; Adobe DNG 1.6, chapter 4.
"""

import io
import struct
from collections.abc import Mapping
from typing import BinaryIO, NamedTuple

import numpy as np

from procedures.numerics.arrays import Array, Array32
from procedures.outcome import BadInput

WIDTH, LENGTH = 256, 257
TILE_WIDTH, TILE_LENGTH = 322, 323
SAMPLES_PER_PIXEL = 277
PLANAR = 284
SUB_DIRECTORIES = 330
BITS_PER_SAMPLE = 258
COMPRESSION = 259
SAMPLE_FORMAT, FLOATING = 339, 3
PHOTOMETRIC = 262
WHITE_IS_ZERO = 0
ORIENTATION = 274
CFA = 32803
LINEAR_RAW = 34892
CFA_REPEAT, CFA_PATTERN = 33421, 33422
DNG_VERSION = 50706
ACTIVE_AREA = 50829
BLACK_REPEAT = 50713
BLACK_LEVEL = 50714
BLACK_DELTA_COLUMNS = 50715
BLACK_DELTA_ROWS = 50716
ICC_PROFILE = 34675

Tags = Mapping[int, tuple[float, ...]]

WANTED = frozenset((
    WIDTH, LENGTH, TILE_WIDTH, TILE_LENGTH, SAMPLES_PER_PIXEL, PLANAR, SUB_DIRECTORIES, BITS_PER_SAMPLE, PHOTOMETRIC,
    COMPRESSION, SAMPLE_FORMAT,
    CFA_REPEAT, CFA_PATTERN, DNG_VERSION, ACTIVE_AREA, BLACK_REPEAT, BLACK_LEVEL, BLACK_DELTA_COLUMNS, BLACK_DELTA_ROWS,
    ICC_PROFILE,
))  # fmt: skip
"""Tags whose values are read."""

# type code -> (struct letter, number of items per value)
_KINDS = {1: ("B", 1), 3: ("H", 1), 4: ("I", 1), 5: ("I", 2), 6: ("b", 1), 7: ("B", 1), 8: ("h", 1), 9: ("i", 1),
          10: ("i", 2), 11: ("f", 1), 12: ("d", 1), 13: ("I", 1), 16: ("Q", 1)}  # fmt: skip
_TYPES = range(1, 19)  # known types of fields, including those of manufacturers and BigTIFF
MOST_DIRECTORIES = 32  # limit of directories; cameras write up to ten: mosaic, previews, metadata
MOST_TAGS = 1000  # limit of tags per directory; cameras write up to a hundred
MOST_VALUES = 1 << 17  # limit of values per tag: a black level for each row of the largest sensor


class _Form(NamedTuple):
    """Byte order and integer sizes of a TIFF, or of a BigTIFF with counts and pointers of eight bytes."""

    order: str
    number: str
    pointer: str
    begin: int

    def read(self, file: BinaryIO, letter: str) -> int:
        layout = self.order + letter
        (number,) = struct.unpack(layout, file.read(struct.calcsize(layout)))
        return int(number)


def mosaic_tags(file: BinaryIO, name: str = "the file") -> Tags:
    """Numeric tags of the directory with the mosaic or monochrome samples of a DNG; empty for other files.

    Other RAW files are left to LibRaw, as manufacturers use some tags differently. Raises as `image_directories`.
    """
    directories = image_directories(file, name)
    if not any(DNG_VERSION in tags for tags in directories):
        return {}
    return next((tags for tags in directories if tags.get(PHOTOMETRIC) == (CFA,) or is_monochrome(tags)), {})


def is_monochrome(tags: Tags) -> bool:
    """Whether the tags are of a monochrome sensor: linear samples, one per pixel (DNG 1.6, chapter 3)."""
    return tags.get(PHOTOMETRIC) == (LINEAR_RAW,) and tags.get(SAMPLES_PER_PIXEL) == (1,)


def image_directories(file: BinaryIO, name: str = "the file") -> list[Tags]:
    """Read the `WANTED` tags of every image directory, in the file's order.

    Raises BadInput if it has too many directories, or too many tags in one of them.

    file : a seekable binary file; files other than TIFF, or damaged ones, give no directories
    name : str, name of the file for messages
    """
    try:
        # all image directories: the chain from the header, and their sub-directories
        form = _form(file)
        if form is None:
            return []
        pending = [form.read(file, form.pointer)]
        directories: dict[int, Tags] = {}
        while pending:
            at = pending.pop(0)
            if at == 0 or at in directories:
                continue
            if len(directories) == MOST_DIRECTORIES:
                raise BadInput(
                    f"a file must have at most {MOST_DIRECTORIES} image directories; {name} has more", _NO_CAMERA
                )
            directories[at], following = _directory(file, form, at, name)
            pending += [int(v) for v in directories[at].get(SUB_DIRECTORIES, ())[: MOST_DIRECTORIES + 1]] + [following]
        return list(directories.values())
    except (struct.error, OSError, OverflowError):
        return []


def has_directory(file: BinaryIO) -> bool:
    """Whether a file has a complete first image directory that begins with a field of a known type."""
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
    """Reset the orientation of a TIFF's first page, so that decoders do not rotate it; other files are unchanged."""
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
    """Format of integers; None for other files. The pointer to the first directory follows in the file."""
    file.seek(0)
    head = file.read(4)
    order = {b"II": "<", b"MM": ">"}.get(head[:2])
    if order is None or len(head) < 4:
        return None
    if struct.unpack(order + "H", head[2:])[0] != BIG:
        return _Form(order, "H", "I", 12)
    return _Form(order, "Q", "Q", 20) if file.read(4) == struct.pack(order + "HH", 8, 0) else None


LARGEST_COUNT = 0xFFFF  # limit of tags in a TIFF's directory; a BigTIFF could declare more than fits into memory
BIG = 43  # version number of BigTIFF


_NO_CAMERA = "give the camera's original file"


def _directory(file: BinaryIO, form: _Form, at: int, name: str) -> tuple[Tags, int]:
    """Wanted tags of the directory at an offset, and the offset of the next one."""
    file.seek(at)
    count = form.read(file, form.number)
    if count > MOST_TAGS:
        if form.read(file, "I") >> (16 if form.order == "<" else 0) & 0xFFFF not in _TYPES:
            raise struct.error("not a directory")
        reason = f"an image directory must have at most {MOST_TAGS} tags; {name} has one of {count}"
        raise BadInput(reason, _NO_CAMERA)
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
    """Values of one entry, stored in its last bytes or at the offset given there."""
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


def written_black(tags: Tags, first: tuple[int, int], shape: tuple[int, int], name: str) -> Array32:
    """Black level of a mosaic's plane by its tags, one number or one per row and column.

    Raises BadInput if the number of levels is wrong, or a level is not a number.

    tags : tags of a mosaic, including BLACK_LEVEL
    first : (row, column) of the plane's first pixel on the whole sensor
    shape : (rows, columns) of the plane
    """
    top, left = (int(v) for v in (*tags.get(ACTIVE_AREA, ()), 0, 0)[:2])
    row, column = first[0] - top, first[1] - left
    level = np.asarray(_repeated_black(tags, name)[row % 2, column % 2])
    if BLACK_DELTA_ROWS in tags:
        level = level + _delta(tags[BLACK_DELTA_ROWS], row, shape[0], "row", name)[:, None]
    if BLACK_DELTA_COLUMNS in tags:
        level = level + _delta(tags[BLACK_DELTA_COLUMNS], column, shape[1], "column", name)
    if not np.isfinite(level).all():
        raise BadInput(f"black levels must be finite numbers; {name} has others", "correct its DNG tag BlackLevel")
    return level.astype(np.float32)


def written_black_everywhere(tags: Tags, first: tuple[int, int], shape: tuple[int, int], name: str) -> Array32:
    """Black level of every pixel of a sensor without a mosaic. Raises BadInput."""
    black = np.empty(shape, np.float32)
    for row, column in np.ndindex(2, 2):
        part = black[row::2, column::2]
        part[:] = written_black(tags, (first[0] + row, first[1] + column), (part.shape[0], part.shape[1]), name)
    return black


def _delta(values: tuple[float, ...], first: int, n: int, what: str, name: str) -> Array:
    """Offsets of the black level of each row or column of a plane."""
    offsets = np.array(values[max(first, 0) :: 2][:n], dtype=np.float64)
    if len(offsets) != n:
        reason = f"BlackLevelDelta must have one value per {what}; {name} has {len(values)}"
        raise BadInput(reason, f"correct its DNG tag BlackLevelDelta{'V' if what == 'row' else 'H'}")
    return offsets


def _repeated_black(tags: Tags, name: str) -> Array:
    """BlackLevel pattern (2, 2), by position in the active area."""
    rows, columns = (int(v) for v in (*tags.get(BLACK_REPEAT, ()), 1, 1)[:2])
    levels = np.array(tags[BLACK_LEVEL], dtype=np.float64)
    if levels.size != rows * columns or not levels.size:
        reason = f"a repeat pattern of {rows} x {columns} requires as many black levels; {name} has {levels.size}"
        raise BadInput(reason, "correct its DNG tag BlackLevelRepeatDim, or write one black level")
    if np.ptp(levels) == 0:
        return np.full((2, 2), levels[0])
    if 2 % rows or 2 % columns:
        reason = f"black must be one level per plane; {name} repeats it every {rows} x {columns} pixels"
        raise BadInput(reason, "write one black level for each position of the 2 x 2 mosaic")
    return np.tile(levels.reshape(rows, columns), (2 // rows, 2 // columns))
