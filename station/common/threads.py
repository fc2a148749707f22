"""How many threads a measurement may use: as many as there are cores, or fewer beside other processes."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_LIMIT: ContextVar[int | None] = ContextVar("threads", default=None)


def threads() -> int:
    """Number of threads."""
    return _LIMIT.get() or os.cpu_count() or 1


@contextmanager
def limited(most: int) -> Iterator[None]:
    """Within, no more than this."""
    before = _LIMIT.set(most)
    try:
        yield
    finally:
        _LIMIT.reset(before)
