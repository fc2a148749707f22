"""A clock that can run faster than time, and one that jumps.

`FastClock` is the system's clock times a factor. `VirtualClock` stands still until somebody waits; then, when every
reader has read all that is due, it jumps to the next thing that happens: a device's event or a waiter's deadline.
Waiting costs no time and slow machines miss no deadline.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol


class Source(Protocol):
    """Something that changes by itself at times it can tell."""

    def next_event_s(self) -> float | None:
        """When it changes next; None if it will not."""
        ...

    def wake(self) -> None:
        """Be up to date with the clock."""
        ...

    def settled(self) -> bool:
        """Whether all it has given out was taken."""
        ...

    def settle(self, real_s: float) -> None:
        """Wait until settled, at most `real_s` seconds of real time."""
        ...


class FastClock:
    """The system's clock, `speed` times as fast."""

    def __init__(self, speed: float = 1.0) -> None:
        self.speed = speed
        self._start = time.monotonic()

    def attach(self, source: Source) -> None:
        """Sources wake themselves by `real_s`."""

    def detach(self, source: Source) -> None:
        """Nothing to forget."""

    def now_s(self) -> float:
        """Seconds since it was made, times the speed."""
        return (time.monotonic() - self._start) * self.speed

    def sleep(self, duration_s: float) -> None:
        """Block this thread."""
        time.sleep(max(duration_s, 0.0) / self.speed)

    def wait(self, condition: threading.Condition, ready: Callable[[], bool], deadline_s: float) -> bool:
        """Wait, holding `condition`, until `ready()` or the deadline."""
        return condition.wait_for(ready, max(deadline_s - self.now_s(), 0.0) / self.speed)

    def real_s(self, moment_s: float) -> float | None:
        """Real seconds until that moment."""
        return max(moment_s - self.now_s(), 0.0) / self.speed


class VirtualClock:
    """Time that passes only while it is waited for."""

    PATIENCE_S = 2.0  # real seconds a reader may take for what it was given

    def __init__(self) -> None:
        self._now_s = 0.0
        self._one = threading.Lock()
        self._book = threading.Lock()
        self._sources: list[Source] = []
        self._deadlines: dict[object, float] = {}

    def attach(self, source: Source) -> None:
        """Let time pass in steps of this source's events too."""
        with self._book:
            self._sources.append(source)

    def detach(self, source: Source) -> None:
        """Forget a source."""
        with self._book:
            self._sources.remove(source)

    def now_s(self) -> float:
        """Seconds since it was made."""
        return self._now_s

    def real_s(self, moment_s: float) -> float | None:
        """None: it never becomes that moment by itself."""
        return None

    def sleep(self, duration_s: float) -> None:
        """Let time pass."""
        condition = threading.Condition()
        with condition:
            self.wait(condition, lambda: False, self._now_s + max(duration_s, 0.0))

    def wait(self, condition: threading.Condition, ready: Callable[[], bool], deadline_s: float) -> bool:
        """Wait, holding `condition`, until `ready()` or the deadline, letting time pass."""
        with self._registered(deadline_s):
            while not ready() and self._now_s < deadline_s:
                condition.release()
                try:
                    self._step(condition, ready)
                finally:
                    condition.acquire()
            return ready()

    @contextmanager
    def _registered(self, deadline_s: float) -> Iterator[None]:
        token = object()
        with self._book:
            self._deadlines[token] = deadline_s
        try:
            yield
        finally:
            with self._book:
                del self._deadlines[token]

    def _step(self, condition: threading.Condition, ready: Callable[[], bool]) -> None:
        """Let the readers finish; if that was not what is waited for, jump to the next event."""
        with self._one:
            with self._book:
                sources = list(self._sources)
            for source in sources:
                source.settle(self.PATIENCE_S)
            with condition:
                if ready():
                    return
            if not all(source.settled() for source in sources):
                return
            with self._book:
                moments = [moment for source in sources if (moment := source.next_event_s()) is not None]
                self._now_s = max(self._now_s, min(moments + list(self._deadlines.values())))
            for source in sources:
                source.wake()
