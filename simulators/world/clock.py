"""Clocks that run faster than real time, or jump.

`FastClock` is the system's clock times a factor. `VirtualClock` stands still until a thread waits; once every
reader has read everything due, it jumps to the next event of a device or deadline of a waiting thread. Waiting costs
no real time, or a fraction of it, and slow machines miss no deadline.
"""

import math
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol


class EventSource(Protocol):
    """A source of spontaneous changes at known times."""

    def next_event_s(self) -> float | None:
        """When it changes next; None if never."""

    def wake(self) -> None:
        """Advance to the clock's time."""

    def settled(self) -> bool:
        """Whether all of its output was read; true of instantaneous changes."""
        return True

    def settle(self, real_s: float) -> None:
        """Wait until settled, at most `real_s` seconds of real time; no-op for instantaneous changes."""
        return


class FastClock:
    """The system's clock, `speed` times as fast."""

    def __init__(self, speed: float = 1.0) -> None:
        self.speed = speed
        self._start = time.monotonic()

    def attach(self, source: EventSource) -> None:
        """No-op: sources wake themselves by `real_s`."""

    def detach(self, source: EventSource) -> None:
        """No-op."""

    def now_s(self) -> float:
        """Seconds since its creation, times the speed."""
        return (time.monotonic() - self._start) * self.speed

    def sleep(self, duration_s: float) -> None:
        time.sleep(max(duration_s, 0.0) / self.speed)

    def wait(self, condition: threading.Condition, ready: Callable[[], bool], deadline_s: float) -> bool:
        return condition.wait_for(ready, max(deadline_s - self.now_s(), 0.0) / self.speed)

    def real_s(self, moment_s: float) -> float | None:
        """Real seconds until that moment."""
        return max(moment_s - self.now_s(), 0.0) / self.speed


@dataclass(frozen=True)
class WaitingThread:
    """A waiting thread: its condition and deadline."""

    condition: threading.Condition
    ready: Callable[[], bool]
    deadline_s: float


class VirtualClock:
    """Time that passes only while all threads wait: readers for bytes, others for a condition.

    Threads started by `together` are waited for as well; any other thread is treated as slow. With a `speed` waiting
    takes its time over that speed.
    """

    PATIENCE_S = 2.0  # real time for a reader to read what is due
    BREATH_S = 0.0002
    SHORT_S, LONG_S = 0.002, 0.02  # a wait in real time is at least and at most that long

    def __init__(self, speed: float = math.inf) -> None:
        self.speed = speed
        self._now_s = self._due_s = 0.0
        self._one = threading.Lock()
        self._book = threading.Lock()
        self._sources: list[EventSource] = []
        self._waiters: dict[object, WaitingThread] = {}
        self._running = 0
        self._own = threading.local()

    def attach(self, source: EventSource) -> None:
        """Let time also advance to this source's events."""
        with self._book:
            self._sources.append(source)

    def detach(self, source: EventSource) -> None:
        with self._book:
            self._sources.remove(source)

    def now_s(self) -> float:
        return self._now_s

    def real_s(self, moment_s: float) -> float | None:
        """None: time never passes by itself."""
        return None

    def sleep(self, duration_s: float) -> None:
        condition = threading.Condition()
        with condition:
            self.wait(condition, lambda: False, self._now_s + max(duration_s, 0.0))

    def together(self, *works: Callable[[], object]) -> list[object]:
        """Run these in threads that share the time; returns what each returned or raised."""

        def run(work: Callable[[], object]) -> object:
            self._own.enrolled = True
            try:
                return work()
            except Exception as error:  # returned like a result
                return error
            finally:
                self._count(-1)

        self._count(len(works))
        with ThreadPoolExecutor(len(works)) as threads:
            return list(threads.map(run, works))

    def stand_in(self) -> None:
        """This thread works for a thread of `together` that waits for it outside this clock: time may pass for both."""
        self._own.enrolled = True

    def _count(self, change: int) -> None:
        with self._book:
            self._running += change

    def wait(self, condition: threading.Condition, ready: Callable[[], bool], deadline_s: float) -> bool:
        """Wait, holding `condition`, until `ready()` or the deadline; time passes meanwhile."""
        if ready() or self._now_s >= deadline_s:
            return ready()
        waiter = WaitingThread(condition, ready, deadline_s)
        with self._registered(waiter):
            while not ready() and self._now_s < deadline_s:
                condition.release()
                try:
                    self._step(waiter)
                finally:
                    condition.acquire()
            return ready()

    @contextmanager
    def _registered(self, waiter: WaitingThread) -> Iterator[None]:
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

    def _step(self, me: WaitingThread) -> None:
        """Let all runnable threads finish; then jump to the next event or deadline."""
        with self._one:
            with self._book:
                sources, waiters, busy = list(self._sources), list(self._waiters.values()), self._running > 0
            for source in sources:
                source.settle(self.PATIENCE_S)
            if self._may_go_on(me):
                return
            others = any(self._may_go_on(waiter) for waiter in waiters if waiter is not me)
            if not (busy or others) and all(source.settled() for source in sources):
                with self._book:
                    moments = [waiter.deadline_s for waiter in self._waiters.values()]
                    moments += [moment for source in sources if (moment := source.next_event_s()) is not None]
                    step_s = min(max(min(moments) - self._now_s, 0.0), self.LONG_S * self.speed)
                    self._due_s += step_s / self.speed
                if self._due_s > self.SHORT_S:
                    time.sleep(self._due_s)
                    self._due_s = 0.0
                self._now_s += step_s
                for source in sources:
                    source.wake()
                return
        time.sleep(self.BREATH_S)

    def _may_go_on(self, waiter: WaitingThread) -> bool:
        with waiter.condition:
            return self._now_s >= waiter.deadline_s or waiter.ready()
