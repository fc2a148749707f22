"""Folders that a program fills and removes; what one that was killed left behind, the next run removes.

A folder is somebody's while its descriptor is locked, and the system takes the lock away from who dies.
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
"""Of folders among the system's temporary files."""
RANDOM_BYTES = 8
"""Told in hexadecimal after the prefix: a folder that a person called `station-demo` is none of these."""


def hold(folder: Path) -> int | None:
    """A descriptor that keeps `sweep` from this folder until it is closed; None where there are no such locks.

    Raises
    ------
    BlockingIOError
        If somebody holds it.
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
    except OSError:  # some file systems of networks lock no folders
        os.close(descriptor)
        return None
    return descriptor


def release(descriptor: int | None) -> None:
    """Give what `hold` gave back."""
    if descriptor is not None:
        os.close(descriptor)


def make(prefix: str, within: Path, mode: int = 0o700) -> tuple[Path, int | None]:
    """A new folder and its `hold`. Raises OSError."""
    for _ in range(100):
        folder = within / f"{prefix}{secrets.token_hex(RANDOM_BYTES)}"
        folder.mkdir(mode)
        with contextlib.suppress(BlockingIOError, FileNotFoundError):  # a sweep came between the two
            descriptor = hold(folder)
            if folder.exists():
                return folder, descriptor
            release(descriptor)
    raise OSError(f"{within} takes no folder that stays")


def sweep(within: Path, prefix: str) -> None:
    """Remove folders that `make` made for this user and nobody holds; what cannot be removed is left."""
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
    """A folder among the system's temporary files, removed at the end; those of runs that were killed are, too."""
    among = Path(tempfile.gettempdir())
    sweep(among, PREFIX)
    folder, descriptor = make(PREFIX, among)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        release(descriptor)
