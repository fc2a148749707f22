"""The tags of a TIFF-like file's image directories, as far as a RAW reader needs them.

LibRaw forgets where a black level was written: it drops repeat patterns other than 2 x 2, replaces the level by the
mean of MaskedAreas, and does not move the pattern when it trims an odd ActiveArea. The tags say what was meant.
Reference: TIFF 6.0, section 2; Adobe DNG 1.6, chapter 4.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import BinaryIO

SUB_DIRECTORIES = 330
BITS_PER_SAMPLE = 258
PHOTOMETRIC = 262
WHITE_IS_ZERO = 0
CFA = 32803
CFA_PATTERN = 33422
DNG_VERSION = 50706
ACTIVE_AREA = 50829
BLACK_REPEAT = 50713
BLACK_LEVEL = 50714
BLACK_DELTA_COLUMNS = 50715
BLACK_DELTA_ROWS = 50716

Tags = Mapping[int, tuple[float, ...]]

# type code -> (struct letter, how many of them make one value)
_KINDS = {1: ("B", 1), 3: ("H", 1), 4: ("I", 1), 5: ("I", 2), 6: ("b", 1), 8: ("h", 1), 9: ("i", 1), 10: ("i", 2),
          11: ("f", 1), 12: ("d", 1), 13: ("I", 1)}  # fmt: skip
_TYPES = range(1, 19)
"""Of fields, the makers' additions and BigTIFF's included."""
_MOST_DIRECTORIES = 64
_MOST_VALUES = 1 << 17


def mosaic_tags(file: BinaryIO) -> Tags:
    """The numeric tags of the directory that holds a DNG file's mosaic; empty where there is none to be read.

    Other RAW files are left to LibRaw: their makers use some of the same tags in their own ways.
    """
    directories = image_directories(file)
    if not any(DNG_VERSION in tags for tags in directories):
        return {}
    return next((tags for tags in directories if tags.get(PHOTOMETRIC) == (CFA,)), {})


def image_directories(file: BinaryIO) -> list[Tags]:
    """The numeric tags of every image directory, in the file's order.

    Parameters
    ----------
    file : a seekable binary file
        Any file; what is no TIFF, or a broken one, gives no directories.
    """
    try:
        return _directories(file)
    except (struct.error, OSError):
        return []


def has_directory(file: BinaryIO) -> bool:
    """Whether a file has a whole first image directory, which begins with a field of a known type."""
    file.seek(0)
    head = file.read(8)
    order = {b"II": "<", b"MM": ">"}.get(head[:2])
    if order is None or len(head) < 8:
        return False
    file.seek(struct.unpack(order + "I", head[4:])[0])
    count = file.read(2)
    size = 12 * struct.unpack(order + "H", count)[0] if len(count) == 2 else 0
    entries = file.read(size)
    return size > 0 and len(entries) == size and struct.unpack(order + "H", entries[2:4])[0] in _TYPES


def _directories(file: BinaryIO) -> list[Tags]:
    """All image directories: the chain from the header, and what it refers to as sub-directories."""
    file.seek(0)
    head = file.read(8)
    order = {b"II": "<", b"MM": ">"}.get(head[:2])
    if order is None:
        return []
    waiting = [struct.unpack(order + "I", head[4:])[0]]
    found: dict[int, Tags] = {}
    while waiting and len(found) < _MOST_DIRECTORIES:
        at = waiting.pop(0)
        if at == 0 or at in found:
            continue
        found[at], following = _directory(file, order, at)
        waiting += [int(v) for v in found[at].get(SUB_DIRECTORIES, ())] + [following]
    return list(found.values())


def _directory(file: BinaryIO, order: str, at: int) -> tuple[Tags, int]:
    """The numeric tags of the directory at an offset, and the offset of the next one."""
    file.seek(at)
    (count,) = struct.unpack(order + "H", file.read(2))
    entries = file.read(12 * count)
    (following,) = struct.unpack(order + "I", file.read(4))
    tags = {}
    for start in range(0, 12 * count, 12):
        code, kind, n = struct.unpack_from(order + "HHI", entries, start)
        if kind in _KINDS and n <= _MOST_VALUES:
            tags[code] = _values(file, order, kind, n, entries[start + 8 : start + 12])
    return tags, following


def _values(file: BinaryIO, order: str, kind: int, n: int, field: bytes) -> tuple[float, ...]:
    """The values of one entry, which lie in its last four bytes or where these point to."""
    letter, parts = _KINDS[kind]
    layout = f"{order}{n * parts}{letter}"
    size = struct.calcsize(layout)
    if size > 4:
        file.seek(struct.unpack(order + "I", field)[0])
        field = file.read(size)
    numbers = struct.unpack(layout, field[:size])
    if parts == 1:
        return numbers
    return tuple(a / b if b else float("nan") for a, b in zip(numbers[::2], numbers[1::2], strict=True))
