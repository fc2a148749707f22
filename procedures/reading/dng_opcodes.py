"""Opcodes of a DNG: what a developer is to do with the picture, written into a copy of the file, and read.

Nothing of the file is changed but one pointer: the directory of the mosaic is written again at the end, its tags as
they were, OpcodeList2 (applied to the mosaic) and OpcodeList3 (to the demosaicked picture) beside them.
Reference: Adobe DNG 1.6, chapters 4 and 7.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.outcome import BadInput

OPCODE_LIST_2, OPCODE_LIST_3 = 51009, 51022
WARP_RECTILINEAR, FIX_VIGNETTE_RADIAL, GAIN_MAP = 1, 3, 9
VERSION = bytes((1, 3, 0, 0))
"""Of the specification that has these opcodes."""
OPTIONAL = 1
"""Flag: a reader that does not know an opcode may leave it out."""
UNDEFINED, LONG, IFD = 7, 4, 13
PHOTOMETRIC, CFA, LINEAR_RAW = 262, 32803, 34892
SUB_DIRECTORIES, DNG_VERSION = 330, 50706
MOST_TAGS, MOST_DIRECTORIES = 1000, 32


@dataclass(frozen=True)
class Opcode:
    """One opcode: its number, and its parameters as they stand in the file (big-endian)."""

    number: int
    data: bytes


def warp_rectilinear(planes: Sequence[Sequence[float]], centre: tuple[float, float]) -> Opcode:
    """Distortion of each plane: kr0 .. kr3, kt0, kt1, with radii over the centre's distance from the farthest corner.

    A place (x, y) from the centre of the corrected picture lies at (x, y)(kr0 + kr1 r^2 + kr2 r^4 + kr3 r^6) +
    (kt1 (r^2 + 2 x^2) + 2 kt0 x y, kt0 (r^2 + 2 y^2) + 2 kt1 x y) in the photograph. `centre` is (x, y) over the
    frame, 0 to 1.
    """
    flat = [value for plane in planes for value in plane]
    return Opcode(WARP_RECTILINEAR, struct.pack(f">I{len(flat) + 2}d", len(planes), *flat, *centre))


def fix_vignette_radial(terms: Sequence[float], centre: tuple[float, float]) -> Opcode:
    """Gain 1 + k0 r^2 + .. + k4 r^10, radii and centre as for the warp."""
    return Opcode(FIX_VIGNETTE_RADIAL, struct.pack(">7d", *terms, *centre))


@dataclass(frozen=True, eq=False)
class GainMap:
    """Gains over the frame, that of every pixel between four points bilinear.

    Attributes
    ----------
    size : (columns, rows)
        Of the mosaic.
    origin : (x, y)
        First pixel that it is for; others follow at every `pitch` of them.
    gains : (rows, columns) float32
        At points spread evenly from side to side: the first at 0, the last at 1 of the frame, whose pixels' centres lie
        at (i + 1/2) / n.
    """

    size: tuple[int, int]
    origin: tuple[int, int]
    pitch: int
    gains: npt.NDArray[np.float32]

    def opcode(self) -> Opcode:
        """As it stands in a file."""
        (columns, rows), (x, y), (v, h) = self.size, self.origin, self.gains.shape
        area = struct.pack(">10I", y, x, rows, columns, 0, 1, self.pitch, self.pitch, v, h)
        spacing = struct.pack(">4dI", 1 / (v - 1), 1 / (h - 1), 0.0, 0.0, 1)
        return Opcode(GAIN_MAP, area + spacing + self.gains.astype(">f4").tobytes())

    @classmethod
    def of(cls, opcode: Opcode) -> GainMap:
        """From an opcode that `opcode` made."""
        y, x, rows, columns, _, _, pitch, _, v, h = struct.unpack_from(">10I", opcode.data)
        gains = np.frombuffer(opcode.data, ">f4", v * h, offset=76).reshape(v, h).astype(np.float32)
        return cls((columns, rows), (x, y), pitch, gains)


def doubles_of(opcode: Opcode) -> tuple[float, ...]:
    """The numbers of one of these two, the count of planes left out."""
    head = 4 if opcode.number == WARP_RECTILINEAR else 0
    return struct.unpack(f">{(len(opcode.data) - head) // 8}d", opcode.data[head:])


def with_opcodes(data: bytes, opcodes: Sequence[Opcode], name: str, on_mosaic: Sequence[Opcode] = ()) -> bytes:
    """The DNG with these opcodes, in place of those that it had.

    Parameters
    ----------
    opcodes : sequence of Opcode
        For the demosaicked picture.
    on_mosaic : sequence of Opcode
        For the mosaic; where there is none, those of the file stay.

    Raises
    ------
    BadInput
        If it is no DNG, or its directories cannot be followed.
    """
    try:
        order, pointer, entries, following = _mosaic_directory(data, name)
    except struct.error as error:
        raise BadInput(f"{name} ends within a directory", "give the file as the camera wrote it") from error
    out = bytearray(data) + b"\0" * (len(data) % 2)
    lists = {OPCODE_LIST_3: opcodes} | ({OPCODE_LIST_2: on_mosaic} if on_mosaic else {})
    new = []
    for tag, told in lists.items():
        content = _list(told)
        new.append(struct.pack(order + "HHII", tag, UNDEFINED, len(content), len(out)))
        out += content + b"\0" * (len(content) % 2)
    kept = [one for one in entries if struct.unpack_from(order + "H", one)[0] not in lists]
    rewritten = sorted([*kept, *new], key=lambda one: int(struct.unpack_from(order + "H", one)[0]))
    struct.pack_into(order + "I", out, pointer, len(out))
    out += struct.pack(order + "H", len(rewritten)) + b"".join(rewritten) + struct.pack(order + "I", following)
    return bytes(out)


def opcodes_in(data: bytes, name: str, list_tag: int = OPCODE_LIST_3) -> list[Opcode]:
    """The opcodes of one list of a DNG's mosaic; raises BadInput as `with_opcodes`."""
    try:
        order, _, entries, _ = _mosaic_directory(data, name)
        for one in entries:
            tag, _, count, at = struct.unpack(order + "HHII", one)
            if tag == list_tag:
                return _read_list(data[at : at + count])
    except struct.error as error:
        raise BadInput(f"{name} ends within a directory", "give the file as the camera wrote it") from error
    return []


def _list(opcodes: Sequence[Opcode]) -> bytes:
    parts = [struct.pack(">I", len(opcodes))]
    for one in opcodes:
        parts.append(struct.pack(">I4sII", one.number, VERSION, OPTIONAL, len(one.data)) + one.data)
    return b"".join(parts)


def _read_list(data: bytes) -> list[Opcode]:
    file = io.BytesIO(data)
    (count,) = struct.unpack(">I", file.read(4))
    found = []
    for _ in range(min(count, MOST_TAGS)):
        number, _, _, size = struct.unpack(">I4sII", file.read(16))
        found.append(Opcode(number, file.read(size)))
    return found


def _mosaic_directory(data: bytes, name: str) -> tuple[str, int, list[bytes], int]:
    """Byte order, where the pointer to the mosaic's directory stands, its entries, the next one's place."""
    order = {b"II": "<", b"MM": ">"}.get(data[:2], "")
    if not order or struct.unpack_from(order + "H", data, 2)[0] != 42:
        raise BadInput(f"{name} is no DNG file", "give a DNG: its makers' converter writes one from other RAW files")
    waiting, is_dng = [4], False
    seen: set[int] = set()
    found = None
    while waiting and len(seen) < MOST_DIRECTORIES:
        pointer = waiting.pop(0)
        (at,) = struct.unpack_from(order + "I", data, pointer)
        if at == 0 or at in seen:
            continue
        seen.add(at)
        entries, following = _entries(data, at, order, name)
        values = {struct.unpack_from(order + "H", one)[0]: one for one in entries}
        is_dng = is_dng or DNG_VERSION in values
        if found is None and _photometric(values, order) in (CFA, LINEAR_RAW):
            found = pointer, entries, following
        waiting += _sub_pointers(values, at, entries, order)
        waiting.append(at + 2 + 12 * len(entries))
    if found is None or not is_dng:
        raise BadInput(f"{name} has no mosaic of a DNG", "give a DNG file with RAW data")
    return order, *found


def _entries(data: bytes, at: int, order: str, name: str) -> tuple[list[bytes], int]:
    (count,) = struct.unpack_from(order + "H", data, at)
    if count > MOST_TAGS:
        raise BadInput(f"{name} has a directory of {count} tags", "give the file as the camera wrote it")
    entries = [data[at + 2 + 12 * i : at + 14 + 12 * i] for i in range(count)]
    return entries, int(struct.unpack_from(order + "I", data, at + 2 + 12 * count)[0])


def _photometric(values: dict[int, bytes], order: str) -> int:
    one = values.get(PHOTOMETRIC)
    return int(struct.unpack_from(order + "H", one, 8)[0]) if one is not None else -1


def _sub_pointers(values: dict[int, bytes], at: int, entries: list[bytes], order: str) -> list[int]:
    """Where the pointers to sub-directories stand."""
    one = values.get(SUB_DIRECTORIES)
    if one is None:
        return []
    _, kind, count, where = struct.unpack(order + "HHII", one)
    if kind not in (LONG, IFD):
        return []
    if count == 1:
        return [at + 2 + 12 * entries.index(one) + 8]
    return [where + 4 * i for i in range(min(count, MOST_DIRECTORIES))]
