"""One compiler at a time for one kernel: of processes that begin together, the others wait and load its code."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

WAIT_S = 60.0
"""The longest wait: a compiler that was stopped keeps its lock, one that ended does not; a kernel takes seconds."""
STEP_S = 0.05


@contextmanager
def only_one(kept: Path) -> Iterator[None]:
    """A block that one process enters at a time for a file; all do where nothing can be locked, and after WAIT_S."""
    try:
        import fcntl
    except ImportError:  # no such locks on this system
        yield
        return
    path = kept.with_name(f"{kept.name}.lock")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    except OSError:  # nothing can be written: nor is anything kept
        yield
        return
    try:
        _wait(descriptor)
        yield
    finally:
        with suppress(OSError):  # who waits has it open; who comes now finds what was kept
            path.unlink(missing_ok=True)
        with suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_UN)  # a process forked meanwhile has it open too
        os.close(descriptor)


def _wait(descriptor: int) -> None:
    """Lock the file, if that can be done."""
    import fcntl

    end = time.monotonic() + WAIT_S
    while time.monotonic() < end:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            time.sleep(STEP_S)
        except OSError:  # not on this file system
            return
        else:
            return
