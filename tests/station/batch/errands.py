"""Work that other processes find by name: see `test_workers.py`."""

import os
import signal
import time
from dataclasses import dataclass
from multiprocessing import parent_process
from pathlib import Path


@dataclass(frozen=True)
class Errand:
    """Which items end their process, and where it is kept that they did."""

    folder: Path
    deadly: tuple[int, ...] = ()
    deadly_once: tuple[int, ...] = ()
    quits: tuple[int, ...] = ()
    stops_once: tuple[int, ...] = ()
    endless: tuple[int, ...] = ()
    greedy: tuple[int, ...] = ()
    ballast: bytes = b""


def square(item: int, errand: Errand) -> int:
    """The square of a number, unless it is a deadly one."""
    mark = errand.folder / str(item)
    if item in errand.deadly or (item in errand.deadly_once and not mark.exists()):
        with mark.open("a") as file:
            file.write("x")
        os.kill(os.getpid(), signal.SIGKILL)
    if item in errand.quits:
        parent = parent_process().sentinel
        os.closerange(3, parent)  # its pipe ends before it does
        os.closerange(parent + 1, 64)
        time.sleep(0.1)
        os._exit(7 * (item > 0))
    if item in errand.stops_once and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGSTOP)
    while item in errand.endless:
        mark.touch()
        signal.pause()
    if item in errand.greedy:
        try:
            return len(bytearray(1 << 40))
        except MemoryError:
            return -1
    return item * item


def deaf(item: int, errand: Errand) -> bool:
    """Whether the process never hears of Ctrl-C: the mask of its main thread has SIGINT in it, or it is ignored."""
    status = dict(line.split(":\t") for line in Path("/proc/self/status").read_text().splitlines() if ":\t" in line)
    return any(int(status[name], 16) & (1 << (signal.SIGINT - 1)) for name in ("SigBlk", "SigIgn"))
