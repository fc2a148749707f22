"""NumPy's files: npy, and the zip archives of them. An array is read once its header fits the bytes that follow.

Reference: numpy.lib.format, versions 1.0 and 2.0; PKWARE's APPNOTE.TXT, 4.3.16 (end of central directory).
"""

from __future__ import annotations

import io
import math
import reprlib
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
LARGEST, SMALLEST = 1e30, 1e-30
"""Magnitudes within which numbers are read: their squares and ratios, and sums of these, stay finite."""
LONGEST = 1_000_000
"""Pixels along a side of a frame: of no sensor."""
Shape = tuple[int | str | None, ...]
"""Lengths of the axes: a number, a letter for axes of equal length, None for any. Only the number 0 allows no entry."""
_AGAIN = "correct it, or write it again"
_PLAIN = "write it again with numpy.save or numpy.savez_compressed"


def read_npy(path: Path, what: str = "array", remedy: str = _PLAIN) -> npt.NDArray[Any]:
    """The array of an npy file. Raises BadInput if it cannot be read as such, or would take too much memory."""
    return parse_npy(read_file(path, what), str(path), remedy)


def parse_npy(data: bytes, name: str, remedy: str = _PLAIN) -> npt.NDArray[Any]:
    """The array in the bytes of an npy file. Raises BadInput."""
    with decoding(name, "an array of numbers", remedy):
        return _array(bytearray(data))


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


def checked_array(
    value: object,
    what: str,
    shape: Shape | None = None,
    *,
    low: float = -LARGEST,
    high: float = LARGEST,
    finite: bool = True,
    dtype: type[np.floating[Any]] | None = np.float64,
    remedy: str = _AGAIN,
) -> npt.NDArray[Any]:
    """An array that was read, or nested lists of a record, as an array of real numbers.

    Parameters
    ----------
    what : str
        What it is, and where it was read: the subject of the message.
    low, high : float
        Of every number, both included.
    finite : bool
        False leaves the range unchecked where infinities and NaN have a meaning.
    dtype : float type or None
        Of the result; None keeps the array's own.

    Raises
    ------
    BadInput
        If it is of another rank or shape, holds no real numbers, or numbers out of range.
    """
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise BadInput(f"{what} must be rows of equal length; got {reprlib.repr(value)}", remedy) from error
    if array.dtype.kind not in "fiu":
        raise BadInput(f"{what} must be real numbers; got {reprlib.repr(value)}", remedy)
    if shape is not None and not _has_shape(array.shape, shape):
        raise BadInput(f"{what} must be {_in_words(shape)}; got {_in_words(array.shape)}", remedy)
    if finite and array.size:
        least, most = array.min(), array.max()  # NaN where one is
        if not (low <= least and most <= high):
            given = f"{least:g} to {most:g}" if least <= most else "NaN"
            raise BadInput(f"{what} must be finite, from {low:g} to {high:g}; got {given}", remedy)
    return array if dtype is None else np.asarray(array, dtype)


def checked_number(
    value: object, what: str, low: float = -LARGEST, high: float = LARGEST, *, remedy: str = _AGAIN
) -> float:
    """A number of a record. Raises BadInput as `checked_array`."""
    return float(checked_array(value, what, (), low=low, high=high, remedy=remedy))


def _has_shape(lengths: tuple[int, ...], shape: Shape) -> bool:
    named: dict[str, int] = {}
    return len(lengths) == len(shape) and all(
        (length == named.setdefault(wanted, length) if isinstance(wanted, str) else wanted in (length, None))
        and (length > 0 or wanted == 0)
        for length, wanted in zip(lengths, shape, strict=True)
    )


def _in_words(shape: Shape) -> str:
    lengths = ", ".join("any" if one is None else str(one) for one in shape)
    return f"an array ({lengths})" if shape else "one number"
