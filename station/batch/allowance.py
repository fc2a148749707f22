"""Limits of memory and time for one item of a batch."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

LEAST_BYTES = 2_000_000_000
"""Smallest default limit of memory: a photograph of 60 million pixels takes a quarter of it."""
TIME_S = 3600.0
"""Default limit of time, seconds."""


@dataclass(frozen=True)
class Allowance:
    """Limits of an item; None for none.

    memory_bytes : address space in addition to that of the process before it begins.
    """

    memory_bytes: int | None = None
    time_s: float | None = None

    @classmethod
    def fair(cls, jobs: int) -> Allowance:
        """The share of the machine's memory for one of `jobs` processes, and an hour."""
        try:
            whole = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
        except (AttributeError, ValueError, OSError):  # Windows
            return cls(None, TIME_S)
        return cls(max(whole // max(jobs, 1), LEAST_BYTES), TIME_S)


@contextmanager
def limited_memory(allowed: int | None) -> Iterator[None]:
    """Limit further address space within the context; allocations beyond it raise MemoryError. Linux only."""
    if allowed is None or sys.platform != "linux":
        yield
        return
    import resource

    taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    before = resource.getrlimit(resource.RLIMIT_AS)
    most = taken + allowed if before[1] == resource.RLIM_INFINITY else min(taken + allowed, before[1])
    resource.setrlimit(resource.RLIMIT_AS, (most, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def is_stopped(process: int) -> bool:
    """Whether a child of this process is stopped, as by SIGSTOP; its exit status remains to be waited for."""
    if not hasattr(os, "waitid"):
        return False
    try:
        return os.waitid(os.P_PID, process, os.WSTOPPED | os.WNOHANG | os.WNOWAIT) is not None
    except ChildProcessError:  # it has ended, and was waited for
        return False
