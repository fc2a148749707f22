"""Opcodes of a DNG: corrections for the raw converter, written into a copy of the file.

Only the file's versions and one pointer are changed: the directory of the mosaic is written again at the end with its
tags and with OpcodeList2 (applied to the mosaic) and OpcodeList3 (applied to the demosaicked picture).
Reference: Adobe DNG 1.6, chapters 4 and 7.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass

from procedures.numerics.arrays import Array32
from procedures.outcome import BadInput

OPCODE_LIST_2, OPCODE_LIST_3 = 51009, 51022
WARP_RECTILINEAR, FIX_VIGNETTE_RADIAL, GAIN_MAP = 1, 3, 9
VERSION = bytes((1, 3, 0, 0))  # version of the specification that defines these opcodes
OPTIONAL = 1  # flag: a reader may ignore an opcode that it does not support
UNDEFINED, LONG, IFD = 7, 4, 13
PHOTOMETRIC, CFA, LINEAR_RAW = 262, 32803, 34892
SUB_DIRECTORIES, DNG_VERSION, DNG_BACKWARD_VERSION = 330, 50706, 50707
MOST_TAGS, MOST_DIRECTORIES = 1000, 32


@dataclass(frozen=True)
class Opcode:
    """An opcode: its number, and its parameters as stored in the file (big-endian)."""

    number: int
    data: bytes


def warp_rectilinear(planes: Sequence[Sequence[float]], centre: tuple[float, float]) -> Opcode:
    """Distortion of each plane: kr0 .. kr3, kt0, kt1, radii relative to the distance from centre to farthest corner.

    The point (x, y) from the centre of the corrected picture lies at (x, y)(kr0 + kr1 r^2 + kr2 r^4 + kr3 r^6) +
    (kt1 (r^2 + 2 x^2) + 2 kt0 x y, kt0 (r^2 + 2 y^2) + 2 kt1 x y) in the photograph. `centre` is (x, y) relative to
    the frame, 0 to 1.
    """
    flat = [value for plane in planes for value in plane]
    return Opcode(WARP_RECTILINEAR, struct.pack(f">I{len(flat) + 2}d", len(planes), *flat, *centre))


def fix_vignette_radial(terms: Sequence[float], centre: tuple[float, float]) -> Opcode:
    """Gain 1 + k0 r^2 + .. + k4 r^10, radii and centre as in `warp_rectilinear`."""
    return Opcode(FIX_VIGNETTE_RADIAL, struct.pack(">7d", *terms, *centre))


@dataclass(frozen=True, eq=False)
class GainMap:
    """Gains over the frame, with bilinear interpolation.

    size : (columns, rows) size of the mosaic
    origin : (x, y) first pixel that it applies to; others follow at intervals of `pitch`
    gains : (rows, columns) float32, gains at equally spaced points, the first at 0, the last at 1 of the frame, whose
        pixels' centres lie at (i + 1/2) / n
    """

    size: tuple[int, int]
    origin: tuple[int, int]
    pitch: int
    gains: Array32

    def opcode(self) -> Opcode:
        (columns, rows), (x, y), (v, h) = self.size, self.origin, self.gains.shape
        area = struct.pack(">10I", y, x, rows, columns, 0, 1, self.pitch, self.pitch, v, h)
        spacing = struct.pack(">4dI", 1 / (v - 1), 1 / (h - 1), 0.0, 0.0, 1)
        return Opcode(GAIN_MAP, area + spacing + self.gains.astype(">f4").tobytes())


def with_opcodes(data: bytes, opcodes: Sequence[Opcode], name: str, on_mosaic: Sequence[Opcode] = ()) -> bytes:
    """Replace the opcodes of a DNG.

    Raises BadInput if it is not a DNG, or its directories are damaged.

    opcodes : sequence of Opcode, opcodes for the demosaicked picture
    on_mosaic : sequence of Opcode, opcodes for the mosaic; if empty, those of the file stay
    """
    try:
        data = _with_version(data)
        order, pointer, entries, following = _mosaic_directory(data, name)
    except struct.error as error:
        raise BadInput(f"{name} is truncated within a directory", "give the camera's original file") from error
    out = bytearray(data) + b"\0" * (len(data) % 2)
    lists = {OPCODE_LIST_3: opcodes} | ({OPCODE_LIST_2: on_mosaic} if on_mosaic else {})
    new = []
    for tag, list_opcodes in lists.items():
        parts = [struct.pack(">I", len(list_opcodes))]
        for opcode in list_opcodes:
            parts.append(struct.pack(">I4sII", opcode.number, VERSION, OPTIONAL, len(opcode.data)) + opcode.data)
        content = b"".join(parts)
        new.append(struct.pack(order + "HHII", tag, UNDEFINED, len(content), len(out)))
        out += content + b"\0" * (len(content) % 2)
    retained = [entry for entry in entries if struct.unpack_from(order + "H", entry)[0] not in lists]
    rewritten = sorted([*retained, *new], key=lambda one: int(struct.unpack_from(order + "H", one)[0]))
    struct.pack_into(order + "I", out, pointer, len(out))
    out += struct.pack(order + "H", len(rewritten)) + b"".join(rewritten) + struct.pack(order + "I", following)
    return bytes(out)


def _with_version(data: bytes) -> bytes:
    """The file with the version of the opcodes, or its later one: its own, and the oldest that reads it."""
    order = {b"II": "<", b"MM": ">"}.get(data[:2], "")
    if not order:
        return data
    out = bytearray(data)
    (at,) = struct.unpack_from(order + "I", data, 4)
    (count,) = struct.unpack_from(order + "H", data, at)
    for place in range(at + 2, at + 2 + 12 * min(count, MOST_TAGS), 12):
        if struct.unpack_from(order + "H", data, place)[0] in (DNG_VERSION, DNG_BACKWARD_VERSION):
            out[place + 8 : place + 12] = max(VERSION, data[place + 8 : place + 12])
    return bytes(out)


def _mosaic_directory(data: bytes, name: str) -> tuple[str, int, list[bytes], int]:
    """Byte order, offset of the pointer to the mosaic's directory, its entries, offset of the next directory."""
    order = {b"II": "<", b"MM": ">"}.get(data[:2], "")
    if not order or struct.unpack_from(order + "H", data, 2)[0] != 42:
        raise BadInput(f"{name} is not a DNG file", "convert the RAW file to DNG")
    pending, is_dng = [4], False
    visited: set[int] = set()
    result = None
    while pending and len(visited) < MOST_DIRECTORIES:
        pointer = pending.pop(0)
        (at,) = struct.unpack_from(order + "I", data, pointer)
        if at == 0 or at in visited:
            continue
        visited.add(at)
        entries, following = _entries(data, at, order, name)
        values = {struct.unpack_from(order + "H", entry)[0]: entry for entry in entries}
        is_dng = is_dng or DNG_VERSION in values
        photometric = struct.unpack_from(order + "H", values[PHOTOMETRIC], 8)[0] if PHOTOMETRIC in values else None
        if result is None and photometric in (CFA, LINEAR_RAW):
            result = pointer, entries, following
        pending += _sub_pointers(values, at, entries, order)
        pending.append(at + 2 + 12 * len(entries))
    if result is None or not is_dng:
        raise BadInput(f"{name} must be a DNG with a mosaic; it has none", "give a DNG file with RAW data")
    return order, *result


def _entries(data: bytes, at: int, order: str, name: str) -> tuple[list[bytes], int]:
    (count,) = struct.unpack_from(order + "H", data, at)
    if count > MOST_TAGS:
        reason = f"a directory must have at most {MOST_TAGS} tags; {name} has one of {count}"
        raise BadInput(reason, "give the camera's original file")
    entries = [data[at + 2 + 12 * i : at + 14 + 12 * i] for i in range(count)]
    return entries, int(struct.unpack_from(order + "I", data, at + 2 + 12 * count)[0])


def _sub_pointers(values: dict[int, bytes], at: int, entries: list[bytes], order: str) -> list[int]:
    """Offsets of the pointers to sub-directories."""
    one = values.get(SUB_DIRECTORIES)
    if one is None:
        return []
    _, kind, count, where = struct.unpack(order + "HHII", one)
    if kind not in (LONG, IFD):
        return []
    if count == 1:
        return [at + 2 + 12 * entries.index(one) + 8]
    return [where + 4 * i for i in range(min(count, MOST_DIRECTORIES))]
