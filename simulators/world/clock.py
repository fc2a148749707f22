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
from dataclasses import dataclass
from typing import Protocol


class EventSource(Protocol):
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

    def attach(self, source: EventSource) -> None:
        """Sources wake themselves by `real_s`."""

    def detach(self, source: EventSource) -> None:
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


@dataclass(frozen=True)
class Waiter:
    """A thread that waits: for what, and how long."""

    condition: threading.Condition
    ready: Callable[[], bool]
    deadline_s: float


class VirtualClock:
    """Time that passes only while everybody waits: readers for bytes, waiters for their turn.

    Threads started by `together` are waited for, too; others are as if they were slow.
    """

    PATIENCE_S = 2.0  # real seconds a reader may take for what it was given
    BREATH_S = 0.0002

    def __init__(self) -> None:
        self._now_s = 0.0
        self._one = threading.Lock()
        self._book = threading.Lock()
        self._sources: list[EventSource] = []
        self._waiters: dict[object, Waiter] = {}
        self._running = 0
        self._own = threading.local()

    def attach(self, source: EventSource) -> None:
        """Let time pass in steps of this source's events too."""
        with self._book:
            self._sources.append(source)

    def detach(self, source: EventSource) -> None:
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

    def together(self, *works: Callable[[], object]) -> list[object]:
        """Do these things in threads of one time; what each gave or raised."""
        outcomes: list[object] = [None] * len(works)

        def run(i: int) -> None:
            self._own.enrolled = True
            try:
                outcomes[i] = works[i]()
            except Exception as error:  # an outcome like any other
                outcomes[i] = error
            finally:
                self._count(-1)

        self._count(len(works))
        threads = [threading.Thread(target=run, args=(i,)) for i in range(len(works))]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        return outcomes

    def _count(self, change: int) -> None:
        with self._book:
            self._running += change

    def wait(self, condition: threading.Condition, ready: Callable[[], bool], deadline_s: float) -> bool:
        """Wait, holding `condition`, until `ready()` or the deadline, letting time pass."""
        if ready() or self._now_s >= deadline_s:
            return ready()
        waiter = Waiter(condition, ready, deadline_s)
        with self._registered(waiter):
            while not ready() and self._now_s < deadline_s:
                condition.release()
                try:
                    self._step(waiter)
                finally:
                    condition.acquire()
            return ready()

    @contextmanager
    def _registered(self, waiter: Waiter) -> Iterator[None]:
        token, enrolled = object(), int(getattr(self._own, "enrolled", False))
        with self._book:
            self._waiters[token] = waiter
            self._running -= enrolled
        try:
            yield
        finally:
            with self._book:
                del self._waiters[token]
                self._running += enrolled

    def _step(self, me: Waiter) -> None:
        """Let everybody finish who can; then jump to the next event or deadline."""
        with self._one:
            with self._book:
                sources, waiters, busy = list(self._sources), list(self._waiters.values()), self._running > 0
            for source in sources:
                source.settle(self.PATIENCE_S)
            if self._may_go_on(me):
                return
            others = any(self._may_go_on(waiter) for waiter in waiters if waiter is not me)
            if not (busy or others) and all(source.settled() for source in sources):
                self._jump(sources)
                return
        time.sleep(self.BREATH_S)

    def _may_go_on(self, waiter: Waiter) -> bool:
        with waiter.condition:
            return self._now_s >= waiter.deadline_s or waiter.ready()

    def _jump(self, sources: list[EventSource]) -> None:
        with self._book:
            moments = [waiter.deadline_s for waiter in self._waiters.values()]
            moments += [moment for source in sources if (moment := source.next_event_s()) is not None]
            self._now_s = max(self._now_s, min(moments))
        for source in sources:
            source.wake()
