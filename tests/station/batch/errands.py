"""Work that other processes find by name: see `test_workers.py`."""

from __future__ import annotations

import os
import signal
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Errand:
    """Which items end their process, and where it is kept that they did."""

    folder: Path
    deadly: tuple[int, ...] = ()
    deadly_once: tuple[int, ...] = ()
    quits: tuple[int, ...] = ()


def square(item: int, errand: Errand) -> int:
    """The square of a number, unless it is a deadly one."""
    mark = errand.folder / str(item)
    if item in errand.deadly or (item in errand.deadly_once and not mark.exists()):
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if item in errand.quits:
        os._exit(7)
    return item * item
