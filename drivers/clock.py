"""Time as an argument: drivers use a clock object, so that tests and simulated benches need not wait."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Protocol


class Clock(Protocol):
    """Seconds since a fixed moment, and waiting."""

    def now_s(self) -> float:
        """Seconds; monotonic."""
        ...

    def sleep(self, duration_s: float) -> None:
        """Return after `duration_s` seconds."""
        ...

    def wait(self, condition: threading.Condition, ready: Callable[[], bool], deadline_s: float) -> bool:
        """Wait, holding `condition`, until `ready()` or the deadline; returns the last value of `ready()`."""
        ...


class SystemClock:
    """The machine's monotonic clock."""

    def now_s(self) -> float:
        """Seconds since an arbitrary moment."""
        return time.monotonic()

    def sleep(self, duration_s: float) -> None:
        """Block this thread."""
        time.sleep(max(duration_s, 0.0))

    def wait(self, condition: threading.Condition, ready: Callable[[], bool], deadline_s: float) -> bool:
        """Wait, holding `condition`, until `ready()` or the deadline."""
        return condition.wait_for(ready, max(deadline_s - time.monotonic(), 0.0))
