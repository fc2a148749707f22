"""Checks common to all readers: regular files, a limit of memory, and conversion of library errors to BadInput.

Formats declare sizes in a few bytes, and libraries allocate the declared size. Every reader therefore calls `Room.take`
before it decodes, which rejects a file above the limit. The errors that libraries raise on damaged data cannot be
listed: inside `decoding`, all of them become BadInput.
"""

import math
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path

from procedures.outcome import BadInput, BadParameter, ProcedureError

LIMIT = "STATION_LARGEST_MB"  # environment variable: memory limit of one decoded file, in megabytes
DEFAULT_MB = 1000.0  # default limit: a photograph of 250 million samples of four bytes
DISK = "check its permissions and the disk"


def largest_bytes() -> int:
    """Memory limit of one file in bytes. Raises BadParameter for an invalid setting."""
    setting = os.environ.get(LIMIT, "")
    try:
        megabytes = float(setting or DEFAULT_MB)
    except ValueError:
        megabytes = math.nan
    if not 0 < megabytes < math.inf:
        reason = f"{LIMIT} must be a positive number of megabytes; got {setting!r}"
        raise BadParameter(reason, f"unset it, or set {LIMIT}=2000")
    return int(megabytes * 1e6)


class Room:
    """Memory budget of one file; `name` is the file's name for messages."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._taken, self._largest = 0, largest_bytes()

    def take(self, needed: int, what: str) -> None:
        """Reserve bytes for `what`. Raises BadInput if the file exceeds the limit."""
        self._taken += needed
        if self._taken > self._largest:
            megabytes = math.ceil(self._taken / 1e6)
            limit = f"one file may take {self._largest / 1e6:g} MB"
            reason = f"{self.name} has {what}: {megabytes} MB in memory; {limit}"
            raise BadInput(reason, f"if the size is right and the memory suffices, set {LIMIT}={megabytes}")


@contextmanager
def decoding(name: str, kind: str, remedy: str) -> Iterator[None]:
    """Context in which every error becomes BadInput, "NAME cannot be read as KIND"."""
    try:
        yield
    except ProcedureError:
        raise
    except MemoryError as error:
        raise BadInput(f"{name} cannot be read as {kind}: not enough memory", remedy) from error
    except Exception as error:
        raise BadInput(f"{name} cannot be read as {kind}: {_words(error)}", remedy) from error


def _words(error: Exception) -> str:
    """Description of an error; programming errors become "it is incomplete"."""
    if isinstance(error, KeyError | TypeError | AttributeError | IndexError):
        return "it is incomplete, or a part has another type"
    words = " ".join(str(error).split(" <_io.")[0].split())  # one line, without the address of an object
    plain = isinstance(error, ValueError | OSError) and words  # their texts are readable
    return words if plain else f"{type(error).__name__}: {words}".rstrip(": ")


def open_file(path: Path, what: str = "photograph") -> BufferedReader:
    """Open a regular file for reading bytes.

    Raises BadInput if it does not exist, is a folder, a pipe or a device, or cannot be opened.
    """
    try:
        mode = path.stat().st_mode
        if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):  # reading might block, or never end
            raise BadInput(f"{path} must be a file; it is a pipe or a device", f"copy the {what} into a file")
        return path.open("rb")
    except FileNotFoundError as error:
        link = f"; the link leads to {path.readlink()}, which does not exist" if path.is_symlink() else ""
        raise BadInput(f"there is no file {path}{link}", "check the path") from error
    except IsADirectoryError as error:
        raise BadInput(f"{path} is a folder, not a {what}", "give one file in it") from error
    except OSError as error:
        raise BadInput(f"{path} cannot be read: {error.strerror}", DISK) from error


def read_file(path: Path, what: str = "photograph") -> bytes:
    """Read a regular file. Raises BadInput as `open_file`, and if it exceeds the limit."""
    with open_file(path, what) as file:
        try:
            size = os.fstat(file.fileno()).st_size
            Room(str(path)).take(size, "too many bytes")
            return file.read(size)
        except OSError as error:
            raise BadInput(f"{path} cannot be read: {error.strerror}", DISK) from error
