"""What one item of a batch may take, memory and time, so that no photograph endangers the machine or holds the rest."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

LEAST_BYTES = 2_000_000_000
"""Of memory that an item may take where nobody tells: a photograph of 60 million pixels takes a quarter of it."""
TIME_S = 3600.0
"""Seconds that an item may take where nobody tells."""


@dataclass(frozen=True)
class Allowance:
    """What an item may take; None where there is no limit.

    Attributes
    ----------
    memory_bytes : int or None
        Of address space, beside what its process has before it begins.
    time_s : float or None
    """

    memory_bytes: int | None = None
    time_s: float | None = None

    @classmethod
    def fair(cls, jobs: int) -> Allowance:
        """A share of the machine's memory for each of so many processes, and an hour."""
        try:
            whole = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
        except (AttributeError, ValueError, OSError):  # Windows
            return cls(None, TIME_S)
        return cls(max(whole // max(jobs, 1), LEAST_BYTES), TIME_S)


@contextmanager
def limited_memory(allowed: int | None) -> Iterator[None]:
    """Within, the process may take so many bytes of address space more; what takes more gets a MemoryError.

    Linux only: elsewhere the system does not hold to such a limit, and none is set.
    """
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
    """Whether a child of this process is stopped, as by SIGSTOP; nothing is taken from who waits for its end."""
    if not hasattr(os, "waitid"):
        return False
    try:
        return os.waitid(os.P_PID, process, os.WSTOPPED | os.WNOHANG | os.WNOWAIT) is not None
    except ChildProcessError:  # it has ended, and was waited for
        return False
