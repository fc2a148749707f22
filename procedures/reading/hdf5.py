"""Data sets of an HDF5 file, each read once its announced size fits into memory.

With some damaged files the C library does not come to an end, and nothing in this process could stop it. So a file is
gone through once in a process of its own that the system ends.
"""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from procedures.reading.arrays import LARGEST, Shape, checked_array, checked_number
from procedures.reading.guard import Room

if TYPE_CHECKING:
    import h5py


SECONDS = 5
"""Of processor; the field of a sensor takes some tenths."""
PATIENCE_S = 300
"""Seconds on the clock, on a machine that has other things to do."""
PROGRAM = """
import contextlib, sys
path, most, seconds = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
with contextlib.suppress(ImportError):
    import resource
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
import h5py
def look(name, item):
    with contextlib.suppress(Exception):
        dict(item.attrs)
    with contextlib.suppress(Exception):
        if isinstance(item, h5py.Dataset) and item.size * max(item.dtype.itemsize, 8) <= most:
            item[()]
with contextlib.suppress(Exception), h5py.File(path, "r") as file:
    look("", file)
    file.visititems(look)
"""


def check_ends(path: Path, largest: int) -> None:
    """Raise ValueError where the library does not come to an end with a file, or breaks down.

    Parameters
    ----------
    largest : int
        Bytes of the largest data set that is read.
    """
    words = [sys.executable, "-c", PROGRAM, str(path), str(largest), str(SECONDS)]
    try:
        ended = subprocess.run(words, capture_output=True, timeout=PATIENCE_S, check=False).returncode
    except subprocess.TimeoutExpired as error:
        raise ValueError("the HDF5 library does not come to an end with it") from error
    if ended < 0:  # by a signal: of its time, or of a fault in the library
        raise ValueError(f"the HDF5 library does not come to an end with it, or breaks down (signal {-ended})")


class Stored:
    """The data sets of one group, by name; `room` is what the file may still take."""

    def __init__(self, group: h5py.Group, room: Room) -> None:
        self._group, self._room = group, room

    def __contains__(self, name: str) -> bool:
        """Whether the group has this data set."""
        return name in self._group

    def numbers(self, name: str, shape: Shape | None = None, largest: float = LARGEST) -> npt.NDArray[np.float64]:
        """A data set of real numbers. Raises BadInput as `checked_array` and for its memory, ValueError, KeyError."""
        return checked_array(self.values(name), self._where(name), shape, low=-largest, high=largest)

    def count(self, name: str, low: int, high: int) -> int:
        """An attribute that counts something. Raises BadInput, KeyError."""
        return int(checked_number(self._group.attrs[name], self._where(name), low, high))

    def _where(self, name: str) -> str:
        return f"`{name}` of {self._group.name} in {self._room.name}"

    def values(self, name: str) -> npt.NDArray[Any]:
        """A data set of numbers of any kind. Raises as `numbers`."""
        data = self._group[name]
        if data.dtype.hasobject or data.is_virtual or data.external:
            raise ValueError(f"`{name}` holds {data.dtype} that are not in this file, or of no fixed length")
        chunk = math.prod(data.chunks or (0,)) * data.dtype.itemsize
        # beside what is stored: numbers of other precisions are made float64, and a chunk is decoded by itself
        self._room.take(2 * data.size * max(data.dtype.itemsize, 8) + chunk, f"`{name}` of shape {data.shape}")
        found: npt.NDArray[Any] = data[()]
        return found

    def texts(self, name: str) -> list[str]:
        """A data set of texts. Raises as `numbers`."""
        data = self._group[name]
        found = []
        for i in range(len(data)):  # one by one: many may point to one long text
            text = data[i].decode()
            self._room.take(len(text), f"`{name}` of {len(data)} texts")
            found.append(text)
        return found
