"""Atomic writing: a file is written next to its target, synchronised, then renamed."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from procedures.outcome import BadParameter
from station.common.durable_files import Disk


def write_whole(path: Path, data: bytes) -> None:
    """Write the data atomically; an older file of that name stays unchanged until all is written.

    Raises BadParameter if the file cannot be written there; no remnant stays.
    """
    with written(path, lambda beside: beside.write_bytes(data)) as file:
        file.publish()


@dataclass(frozen=True)
class WrittenFile:
    """A file that is complete under a name of its own, its hash, and the name that it shall have."""

    beside: Path
    path: Path
    sha256: str

    def publish(self) -> None:
        """Give it its name. Raises BadParameter."""
        try:
            os.replace(self.beside, self.path)
            Disk().sync_folder(self.path.parent)
        except OSError as error:
            raise _unwritable(self.path, error) from error


@contextmanager
def written(path: Path, write: Callable[[Path], object]) -> Iterator[WrittenFile]:
    """The file that `write` makes beside this path; it is removed afterwards unless it was published.

    Raises BadParameter if the file cannot be written.
    """
    # in the same folder: a rename across file systems would be a copy
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        try:
            write(beside)
            Disk().settle(beside)
            with beside.open("rb") as file:
                sha256 = hashlib.file_digest(file, "sha256").hexdigest()
        except OSError as error:
            raise _unwritable(path, error) from error
        yield WrittenFile(beside, path, sha256)
    finally:
        _remove(beside)


def _unwritable(path: Path, error: OSError) -> BadParameter:
    return BadParameter(
        f"{path} cannot be written: {error.strerror}", "name a file in a folder that exists and can be written"
    )


def _remove(path: Path) -> None:
    # a path that is no folder, or cannot be entered, fails here as well, but was reported already
    try:
        path.unlink(missing_ok=True)
    except OSError:
        return
