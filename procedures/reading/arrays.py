"""NumPy's files: npy, and the zip archives of them. An array is read once its header fits the bytes that follow.

Reference: numpy.lib.format, versions 1.0 and 2.0; PKWARE's APPNOTE.TXT, 4.3.16 (end of central directory).
"""

from __future__ import annotations

import io
import math
import struct
import zipfile
from collections.abc import Container
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from procedures.outcome import BadInput
from procedures.reading.guard import Room, decoding, open_file, read_file

Arrays = dict[str, npt.NDArray[Any]]

LONGEST_HEAD = 1 << 14
"""Bytes within which an array's header ends."""
LARGEST_DIRECTORY = 1 << 20
"""Of an archive's list of members, bytes: some ten thousand of them."""
BLOCK = 1 << 20
_PLAIN = "write it again with numpy.save or numpy.savez_compressed"


def read_npy(path: Path, what: str = "array", remedy: str = _PLAIN) -> npt.NDArray[Any]:
    """The array of an npy file. Raises BadInput if it cannot be read as such, or would take too much memory."""
    data = bytearray(read_file(path, what))
    with decoding(str(path), "an array of numbers", remedy):
        return _array(data)


def read_npz(path: Path, wanted: Container[str], remedy: str = _PLAIN) -> tuple[Arrays, list[str]]:
    """The wanted arrays of an npz archive, and the names of all that are in it; the others are not read.

    Raises
    ------
    BadInput
        If it cannot be read as such, or what is wanted would take too much memory.
    """
    with decoding(str(path), "an npz archive of arrays", remedy), open_file(path, "npz archive") as file:
        _check_directory(file)
        with zipfile.ZipFile(file) as archive:
            members = {one.filename.removesuffix(".npy"): one for one in archive.infolist()}
            chosen = {name: member for name, member in members.items() if name in wanted}
            room = Room(str(path))
            for name, member in chosen.items():
                room.take(member.file_size, f"the array `{name}` of {member.file_size} bytes")
            return {name: _array(_content(archive, member)) for name, member in chosen.items()}, sorted(members)


def _check_directory(file: BinaryIO) -> None:
    """Raise ValueError unless the archive's list of members is there and of a size that can be meant."""
    end = file.seek(0, io.SEEK_END)
    file.seek(max(0, end - (1 << 16) - 22))
    tail = file.read()
    at = tail.rfind(b"PK\5\6")
    if at < 0 or len(tail) < at + 16:
        raise ValueError("it has no list of members, as where its end is missing")
    (size,) = struct.unpack_from("<I", tail, at + 12)
    if size > LARGEST_DIRECTORY:
        raise ValueError(f"its list of members is announced with {size} bytes")


def _content(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> bytearray:
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):  # others bring dictionaries of any size
        raise ValueError(f"{member.filename!r} is compressed in a way that numpy does not write")
    data = bytearray()
    with archive.open(member) as file:
        while block := file.read(BLOCK):
            data += block
    return data


def _array(data: bytearray) -> npt.NDArray[Any]:
    """The array in the bytes of an npy file, sharing their memory. Raises ValueError."""
    head = io.BytesIO(data[:LONGEST_HEAD])
    version = np.lib.format.read_magic(head)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"version {version} of the format is not known")
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, by_columns, kind = read(head)
    if kind.hasobject or kind.fields is not None or kind.itemsize == 0:
        raise ValueError(f"it holds {kind}, no plain numbers")
    if min(shape, default=0) < 0:
        raise ValueError(f"it announces the shape {shape}")
    needed, there = math.prod(shape) * kind.itemsize, len(data) - head.tell()
    if needed != there:
        raise ValueError(f"its header announces {needed} bytes, {there} are there")
    flat = np.frombuffer(data, kind, math.prod(shape), head.tell())
    return flat.reshape(shape[::-1]).T if by_columns else flat.reshape(shape)


def check_real(array: npt.NDArray[Any], name: str) -> None:
    """Raise BadInput unless these are finite real numbers."""
    if array.dtype.kind not in "fiu" or not np.isfinite(array).all():
        raise BadInput(f"{name} holds {array.dtype} that are no finite real numbers", "give numbers")
