"""NumPy's files npy and npz. An array is read only if its header matches the number of bytes that follow.

Reference: numpy.lib.format, versions 1.0 and 2.0; PKWARE's APPNOTE.TXT, 4.3.16 (end of central directory).
"""

import io
import math
import reprlib
import struct
import zipfile
from collections.abc import Container
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.outcome import BadInput
from procedures.reading.guard import Room, decoding, open_file, read_file

Arrays = dict[str, npt.NDArray[Any]]

LONGEST_HEAD = 1 << 14  # greatest length of an array's header, in bytes
LARGEST_DIRECTORY = 1 << 20  # greatest size of an archive's central directory, in bytes: some ten thousand members
BLOCK = 1 << 20
LARGEST, SMALLEST = 1e30, 1e-30  # range of magnitudes that are read: squares and ratios of them stay finite
LONGEST = 1_000_000  # limit of pixels along a side of a frame, beyond any sensor
Shape = tuple[int | str | None, ...]
"""Lengths of the axes: a number, a letter for axes of equal length, None for any. Only 0 allows an empty axis."""
_REWRITE = "correct it, or write it again"
_SAVE_AGAIN = "write it again with numpy.save or numpy.savez_compressed"


def read_npy(path: Path, what: str = "array", remedy: str = _SAVE_AGAIN) -> npt.NDArray[Any]:
    """Read an npy file. Raises BadInput if it is invalid or too large."""
    return parse_npy(read_file(path, what), str(path), remedy)


def parse_npy(data: bytes, name: str, remedy: str = _SAVE_AGAIN) -> npt.NDArray[Any]:
    """Array of the bytes of an npy file. Raises BadInput."""
    with decoding(name, "an array of numbers", remedy):
        return _array(bytearray(data))


def read_npz(path: Path, wanted: Container[str], remedy: str = _SAVE_AGAIN) -> tuple[Arrays, list[str]]:
    """Read the wanted arrays of an npz archive, and the names of all.

    Raises BadInput if it is invalid, or the wanted arrays are too large.
    """
    with decoding(str(path), "an npz archive of arrays", remedy), open_file(path, "npz archive") as file:
        # raise ValueError unless the archive has a central directory of plausible size
        end = file.seek(0, io.SEEK_END)
        file.seek(max(0, end - (1 << 16) - 22))
        tail = file.read()
        at = tail.rfind(b"PK\5\6")
        if at < 0 or len(tail) < at + 16:
            raise ValueError("it is truncated: its list of members is missing")
        (size,) = struct.unpack_from("<I", tail, at + 12)
        if size > LARGEST_DIRECTORY:
            raise ValueError(f"its list of members must have at most {LARGEST_DIRECTORY} bytes; it declares {size}")
        with zipfile.ZipFile(file) as archive:
            members = {one.filename.removesuffix(".npy"): one for one in archive.infolist()}
            chosen = {name: member for name, member in members.items() if name in wanted}
            room = Room(str(path))
            for name, member in chosen.items():
                room.take(member.file_size, f"the array `{name}` of {member.file_size} bytes")
            return {name: _array(_content(archive, member)) for name, member in chosen.items()}, sorted(members)


def _content(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> bytearray:
    # others may use dictionaries of any size
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError(f"{member.filename!r} must be stored or deflated; it has another compression")
    data = bytearray()
    with archive.open(member) as file:
        while block := file.read(BLOCK):
            data += block
    return data


def _array(data: bytearray) -> npt.NDArray[Any]:
    """Array of the bytes of an npy file, sharing their memory. Raises ValueError."""
    head = io.BytesIO(data[:LONGEST_HEAD])
    version = np.lib.format.read_magic(head)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"version {version} of the format is not supported")
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, by_columns, kind = read(head)
    if kind.hasobject or kind.fields is not None or kind.itemsize == 0:
        raise ValueError(f"it must contain plain numbers; it has {kind}")
    if min(shape, default=0) < 0:
        raise ValueError(f"it declares the shape {shape}")
    needed, present = math.prod(shape) * kind.itemsize, len(data) - head.tell()
    if needed != present:
        raise ValueError(f"its header declares {needed} bytes; {present} follow")
    flat = np.frombuffer(data, kind, math.prod(shape), head.tell())
    return flat.reshape(shape[::-1]).T if by_columns else flat.reshape(shape)


def checked_array(
    value: object, what: str, shape: Shape | None = None, *, low: float = -LARGEST, high: float = LARGEST,
    finite: bool = True, dtype: type[np.floating[Any]] | None = np.float64, remedy: str = _REWRITE,
) -> npt.NDArray[Any]:  # fmt: skip
    """Convert a value, an array or nested lists of a record, to an array of real numbers, and check it.

    Raises BadInput if it has another shape, is not real, or has numbers out of range.

    what : str, name and source of the value, the subject of the message
    low, high : float, inclusive limits of the numbers
    finite : bool, false disables the check of the range where infinities and NaN have a meaning
    dtype : float type or None, type of the result; None keeps that of the array
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
        least, most = float(array.min()), float(array.max())  # NaN where one is
        if not (low <= least and most <= high):
            given = f"{least:g} to {most:g}" if least <= most else "NaN"
            raise BadInput(f"{what} must be finite, from {low:g} to {high:g}; got {given}", remedy)
    return array if dtype is None else np.asarray(array, dtype)


def checked_number(
    value: object, what: str, low: float = -LARGEST, high: float = LARGEST, *, remedy: str = _REWRITE
) -> float:
    """Number of a record. Raises BadInput as `checked_array`."""
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
