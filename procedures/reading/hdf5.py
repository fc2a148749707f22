"""Data sets of an HDF5 file, within the limit of memory.

With some damaged files the C library never returns, and nothing in this process could stop it. A file is therefore
first read in a separate process with a time limit.
"""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy.typing as npt

from procedures.numerics.arrays import Array
from procedures.outcome import BadInput
from procedures.reading.arrays import LARGEST, Shape, checked_array, checked_number
from procedures.reading.guard import Room, decoding, largest_bytes, open_file

if TYPE_CHECKING:
    import h5py


CPU_LIMIT_S = 5  # limit of processor time; the field of a sensor takes some tenths
WALL_TIMEOUT_S = 300  # limit of wall time, for a machine under load
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
    """Raise ValueError if the library does not terminate or crashes.

    largest : int, size in bytes of the largest data set that is read
    """
    command = [sys.executable, "-c", PROGRAM, str(path), str(largest), str(CPU_LIMIT_S)]
    try:
        status = subprocess.run(command, capture_output=True, timeout=WALL_TIMEOUT_S, check=False).returncode
    except subprocess.TimeoutExpired as error:
        raise ValueError("the HDF5 library does not terminate") from error
    if status < 0:  # by a signal: time limit or crash
        raise ValueError(f"the HDF5 library does not terminate or crashes (signal {-status})")


@contextmanager
def opened(path: Path | str, what: str, schemas: Sequence[str], remedy: str) -> Iterator[h5py.File]:
    """A file of one of these schemas. Raises BadInput where it is damaged, or of another one."""
    import h5py

    open_file(Path(path), what).close()
    with decoding(str(path), "HDF5", remedy):
        check_ends(Path(path), largest_bytes())
        with h5py.File(path, "r") as file:
            if file.attrs.get("schema") not in schemas:
                reason = f"{path} is no {what} of this version"
                raise BadInput(reason, f"give a file with schema {' or '.join(schemas)}")
            yield file


class Stored:
    """Data sets of one group by name; `room` is the memory budget of the file."""

    def __init__(self, group: h5py.Group, room: Room) -> None:
        self._group, self._room = group, room

    def __contains__(self, name: str) -> bool:
        """Whether the group has this data set."""
        return name in self._group

    def numbers(self, name: str, shape: Shape | None = None, largest: float = LARGEST) -> Array:
        """Data set of real numbers. Raises BadInput as `checked_array` and `Room.take`, ValueError, KeyError."""
        return checked_array(self.values(name), self._where(name), shape, low=-largest, high=largest)

    def count(self, name: str, low: int, high: int) -> int:
        """Attribute that is a count. Raises BadInput, KeyError."""
        return int(checked_number(self._group.attrs[name], self._where(name), low, high))

    def _where(self, name: str) -> str:
        return f"`{name}` of {self._group.name} in {self._room.name}"

    def values(self, name: str) -> npt.NDArray[Any]:
        """Data set of numbers of any type. Raises as `numbers`."""
        data = self._group[name]
        if data.dtype.hasobject or data.is_virtual or data.external:
            raise ValueError(f"`{name}` must be stored in this file with a fixed length; it is {data.dtype}")
        chunk = math.prod(data.chunks or (0,)) * data.dtype.itemsize
        # includes the conversion to float64 and the decoding of a chunk
        self._room.take(2 * data.size * max(data.dtype.itemsize, 8) + chunk, f"`{name}` of shape {data.shape}")
        content: npt.NDArray[Any] = data[()]
        return content

    def texts(self, name: str) -> list[str]:
        """Data set of texts. Raises as `numbers`."""
        data = self._group[name]
        content = []
        for i in range(len(data)):  # one by one, as many may refer to one long text
            text = data[i].decode()
            self._room.take(len(text), f"`{name}` of {len(data)} texts")
            content.append(text)
        return content
