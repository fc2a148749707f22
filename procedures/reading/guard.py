"""The guard before every reader: a file that is one, within a limit of memory; what a library raises becomes a refusal.

Formats announce sizes in a few bytes, and libraries allocate what is announced. So every reader asks here before it
decodes, and a file that would take more than the limit is refused by name. What foreign bytes make a library raise
cannot be listed: within `decoding`, all of it says that the file cannot be read.
"""

from __future__ import annotations

import math
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path

from procedures.outcome import BadInput, BadParameter, ProcedureError

LIMIT = "STATION_LARGEST_MB"
"""Environment variable: what one file may take in memory, decoded, in megabytes."""
DEFAULT_MB = 1000.0
"""Room for a photograph of 250 million samples, each computed with as four bytes."""
DISK = "check its permissions and the disk"


def largest_bytes() -> int:
    """What one file may take in memory. Raises BadParameter where the setting is no such number."""
    told = os.environ.get(LIMIT, "")
    try:
        megabytes = float(told or DEFAULT_MB)
    except ValueError:
        megabytes = math.nan
    if not 0 < megabytes < math.inf:
        raise BadParameter(f"{LIMIT} is a number of megabytes; it is {told!r}", f"unset it, or set {LIMIT}=2000")
    return int(megabytes * 1e6)


class Room:
    """What one file may still take. `name` is the file's, for people."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._taken, self._largest = 0, largest_bytes()

    def take(self, needed: int, what: str) -> None:
        """Raises BadInput where the file would take more than the limit with these bytes more, of `what`."""
        self._taken += needed
        if self._taken > self._largest:
            megabytes = math.ceil(self._taken / 1e6)
            reason = f"{self.name} has {what}: {megabytes} MB in memory, and one file may take {self._largest / 1e6:g}"
            raise BadInput(reason, f"if it is meant so and there is memory for it, set {LIMIT}={megabytes}")


@contextmanager
def decoding(name: str, kind: str, remedy: str) -> Iterator[None]:
    """Within, whatever goes wrong is the file's fault: it raises BadInput, "NAME cannot be read as KIND"."""
    try:
        yield
    except ProcedureError:
        raise
    except MemoryError as error:
        raise BadInput(f"{name} cannot be read as {kind}: it takes more memory than there is", remedy) from error
    except Exception as error:
        raise BadInput(f"{name} cannot be read as {kind}: {_words(error)}", remedy) from error


def _words(error: Exception) -> str:
    """What went wrong, for people: of what only a programmer would understand, that parts are missing."""
    if isinstance(error, KeyError | TypeError | AttributeError | IndexError):
        return "it is not whole, or a part of it is of another kind"
    plain = isinstance(error, ValueError | OSError) and str(error)  # these are written for people
    return str(error) if plain else f"{type(error).__name__}: {error}".rstrip(": ")


def open_file(path: Path, what: str = "photograph") -> BufferedReader:
    """A regular file, opened for its bytes.

    Raises
    ------
    BadInput
        If there is none, it is a folder, a pipe or a device, or cannot be opened.
    """
    try:
        mode = path.stat().st_mode
        if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):  # it would be waited for, or read, without end
            raise BadInput(f"{path} is a pipe or a device, not a {what}", f"copy the {what} into a file")
        return path.open("rb")
    except FileNotFoundError as error:
        link = f"; the link leads to {path.readlink()}, which is not there" if path.is_symlink() else ""
        raise BadInput(f"there is no file {path}{link}", "check the path") from error
    except IsADirectoryError as error:
        raise BadInput(f"{path} is a folder, not a {what}", "name one file in it") from error
    except OSError as error:
        raise BadInput(f"{path} cannot be read: {error.strerror}", DISK) from error


def read_file(path: Path, what: str = "photograph") -> bytes:
    """The whole content of a regular file. Raises BadInput as `open_file`, and where it is larger than the limit."""
    with open_file(path, what) as file:
        try:
            size = os.fstat(file.fileno()).st_size
            Room(str(path)).take(size, "too many bytes")
            return file.read(size)
        except OSError as error:
            raise BadInput(f"{path} cannot be read: {error.strerror}", DISK) from error
