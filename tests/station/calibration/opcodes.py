"""Reader of the opcodes in a DNG."""

import struct

import numpy as np

from procedures.reading.dng_opcodes import OPCODE_LIST_3, WARP_RECTILINEAR, GainMap, Opcode, _mosaic_directory


def opcodes_in(data: bytes, list_tag: int = OPCODE_LIST_3) -> list[Opcode]:
    """Opcodes of one list of a DNG's mosaic."""
    order, _, entries, _ = _mosaic_directory(data, "copy")
    opcodes = []
    for entry in entries:
        tag, _, _, at = struct.unpack(order + "HHII", entry)
        if tag == list_tag:
            (count,) = struct.unpack_from(">I", data, at)
            at += 4
            for _ in range(count):
                number, _, _, size = struct.unpack_from(">I4sII", data, at)
                opcodes.append(Opcode(number, data[at + 16 : at + 16 + size]))
                at += 16 + size
    return opcodes


def doubles_of(opcode: Opcode) -> tuple[float, ...]:
    """Parameters of a warp or vignetting opcode, without the count of planes."""
    head = 4 if opcode.number == WARP_RECTILINEAR else 0
    return struct.unpack(f">{(len(opcode.data) - head) // 8}d", opcode.data[head:])


def gain_map(opcode: Opcode) -> GainMap:
    """Map of a GainMap opcode."""
    y, x, rows, columns, _, _, pitch, _, v, h = struct.unpack_from(">10I", opcode.data)
    gains = np.frombuffer(opcode.data, ">f4", v * h, offset=76).reshape(v, h).astype(np.float32)
    return GainMap((columns, rows), (x, y), pitch, gains)
