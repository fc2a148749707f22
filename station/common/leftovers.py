"""Folders that a program fills and removes; those of a killed program are removed by the next run.

A folder is in use while its descriptor is locked; the system releases the lock of a program that ends.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PREFIX = "station-"
"""Prefix of temporary folders."""
RANDOM_BYTES = 8
"""Hexadecimal part after the prefix: a user's folder called `station-demo` does not match."""


def hold(folder: Path) -> int | None:
    """Lock a folder against `sweep`; returns the descriptor, None on systems without such locks.

    Raises BlockingIOError if it is locked already.
    """
    try:
        import fcntl
    except ImportError:  # Windows
        return None
    descriptor = os.open(folder, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0))
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise
    except OSError:  # some network file systems cannot lock folders
        os.close(descriptor)
        return None
    return descriptor


def release(descriptor: int | None) -> None:
    """Release the lock of `hold`."""
    if descriptor is not None:
        os.close(descriptor)


def make(prefix: str, within: Path, mode: int = 0o700) -> tuple[Path, int | None]:
    """Create a folder and `hold` it. Raises OSError."""
    for _ in range(100):
        folder = within / f"{prefix}{secrets.token_hex(RANDOM_BYTES)}"
        folder.mkdir(mode)
        with contextlib.suppress(BlockingIOError, FileNotFoundError):  # a sweep intervened
            descriptor = hold(folder)
            if folder.exists():
                return folder, descriptor
            release(descriptor)
    raise OSError(f"{within} keeps no new folder")


def sweep(within: Path, prefix: str) -> None:
    """Remove this user's folders made by `make` that are not locked; failures are ignored."""
    for folder in within.glob(prefix + 2 * RANDOM_BYTES * "[0-9a-f]"):
        with contextlib.suppress(OSError):
            status = folder.lstat()
            if folder.is_symlink() or not folder.is_dir() or status.st_uid != os.getuid():
                continue
            descriptor = hold(folder)
            if descriptor is not None:
                shutil.rmtree(folder, ignore_errors=True)
                release(descriptor)


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """A temporary folder, removed at the end; those of killed runs are removed, too."""
    among = Path(tempfile.gettempdir())
    sweep(among, PREFIX)
    folder, descriptor = make(PREFIX, among)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        release(descriptor)
