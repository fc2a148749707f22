"""Work in processes that may die: an item whose process dies is tried once more, then given up.

Processes are spawned: a fork would copy locks that other threads hold. Each computes in one thread: side by side they
use all cores without waiting for each other.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from multiprocessing.reduction import ForkingPickler
from multiprocessing.resource_tracker import ensure_running
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Generic, TypeVar

from procedures.outcome import Refused

LEAST_BYTES = 2_000_000_000
"""Smallest default limit of memory: a photograph of 60 million pixels takes a quarter of it."""
TIME_S = 3600.0


@dataclass(frozen=True)
class Allowance:
    """Limits of an item, None for none; memory_bytes : address space beyond that of the process before it begins."""

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


I = TypeVar("I")  # noqa: E741  (an item)
J = TypeVar("J")
R = TypeVar("R")

TRIES = 2
"""Attempts per item: the system kills the largest process, not the one that caused the shortage."""
DEATHS_IN_A_ROW = 8
"""Consecutive deaths after which the items are not the cause."""
POLL_S = 0.5
STOPPED_S = 2.0
"""Time after which a stopped process is killed; Ctrl-Z stops parent and children, and `fg` continues all."""
GOING_S = 5.0
"""Time for an idle process to end after its pipe is closed, before it is killed."""
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(frozen=True)
class Lost:
    """An item without a result, and the reason why its process ended."""

    reason: str


NO_LIMIT = Allowance()


@dataclass
class Stop:
    """Request to stop: items in work are finished, no other is begun."""

    asked: bool = False

    def ask(self) -> None:
        self.asked = True


@dataclass
class _Worker(Generic[I, J, R]):
    """A process, this end of its pipe, the number of its item, and since when it works on it, or is stopped."""

    function: Callable[[I, J], R]
    job: J
    allowance: Allowance
    busy: int | None = None
    since_s: float | None = None
    stopped_s: float | None = None
    fault: str = ""
    pipe: Connection[Any, Any] = field(init=False)

    def __post_init__(self) -> None:
        context = get_context("spawn")
        self.pipe, other = context.Pipe()
        # small enough for a pipe: otherwise the start would wait for a process that is stopped before it reads
        self.process = context.Process(target=_serve, args=(other, self.allowance), daemon=True)
        with single_threads(), without_interrupts():
            self.process.start()
        other.close()
        self._outgoing: SimpleQueue[bytes | None] = SimpleQueue()
        self._sender = threading.Thread(target=_send, args=(self.pipe, self._outgoing), daemon=True)
        self._sender.start()
        self._outgoing.put(bytes(ForkingPickler.dumps((self.function, self.job))))

    def give(self, number: int, item: I) -> None:
        """Begin an item; the death of a process is noticed when its answer is read."""
        self.busy, self.since_s, self.stopped_s = number, None, None
        self._outgoing.put(bytes(ForkingPickler.dumps(item)))

    def answer(self) -> tuple[int, R | Lost] | None:
        """The number of the item and its answer; None for the message that it was begun."""
        try:
            begun, answer = self.pipe.recv()
        except (EOFError, ConnectionError):
            self.end(at_once=False)
            return self.busy or 0, Lost(self._obituary())
        if begun:
            self.since_s = time.monotonic()
            return None
        number, self.busy = self.busy or 0, None
        return number, answer

    def watch(self) -> None:
        """Kill the process if it exceeds its time, or is stopped: its pipe can then be read to the end."""
        now = time.monotonic()
        most = self.allowance.time_s
        if most is not None and self.since_s is not None and now - self.since_s > most:
            self._kill(f"it took longer than {most:g} s")
        elif not is_stopped(self.process.pid or 0):
            self.stopped_s = None
        elif self.stopped_s is None:
            self.stopped_s = now
        elif now - self.stopped_s > STOPPED_S:
            self._kill("the process that worked on it was stopped (SIGSTOP) and did not go on")

    def _kill(self, fault: str) -> None:
        self.fault = fault
        self.process.kill()

    @property
    def overtime(self) -> bool:
        """Whether it exceeded its time, as another attempt would."""
        return self.fault.startswith("it took longer")

    def _obituary(self) -> str:
        if self.fault:
            return self.fault
        code = self.process.exitcode or 0
        if code < 0:
            return f"the process that worked on it was ended by the system ({signal.Signals(-code).name})"
        return f"the process that worked on it ended by itself (exit code {code})"

    def end(self, at_once: bool) -> None:
        self._outgoing.put(None)
        if not at_once:
            self.process.join(GOING_S)
        self.process.kill()
        self.process.join()
        self._sender.join()
        self.pipe.close()


def run_in_processes(
    function: Callable[[I, J], R], job: J, items: Sequence[I], jobs: int, stop: Stop, allowance: Allowance = NO_LIMIT
) -> Generator[tuple[int, R | Lost], None, None]:
    """Yield number and `function(item, job)` of every item, as they are finished.

    Raises Refused if `DEATHS_IN_A_ROW` processes die.

    function : importable by its name
    jobs : processes at a time
    stop : on request items in work are finished, and the others omitted
    allowance : limits of each item; a process that exceeds its time, or is stopped, is killed
    """
    waiting, deaths, in_a_row = deque(range(len(items))), Counter[int](), 0
    workers: list[_Worker[I, J, R]] = []
    try:
        while True:
            _feed(workers, waiting, items, partial(_Worker, function, job, allowance), 0 if stop.asked else jobs)
            busy = [worker for worker in workers if worker.busy is not None]
            if not busy:
                break
            ready = wait([worker.pipe for worker in busy], POLL_S)
            for worker in busy:
                if worker.pipe not in ready:
                    worker.watch()
            for worker in (one for one in busy if one.pipe in ready):
                if (message := worker.answer()) is None:
                    continue
                number, answer = message
                in_a_row = in_a_row + 1 if isinstance(answer, Lost) else 0
                if isinstance(answer, Lost):
                    workers.remove(worker)
                    _check_alive(in_a_row, answer.reason)
                    deaths[number] += TRIES if worker.overtime else 1
                    if deaths[number] < TRIES:
                        waiting.appendleft(number)
                        continue
                    answer = answer if worker.overtime else Lost(f"{answer.reason}, {TRIES} times")
                yield number, answer
        for worker in workers:
            worker.end(at_once=False)
        workers = []
    finally:
        for worker in workers:
            worker.end(at_once=True)


def _feed(
    workers: list[_Worker[I, J, R]], waiting: deque[int], items: Sequence[I], make: Callable[[], _Worker[I, J, R]],
    jobs: int,
) -> None:  # fmt: skip
    """Give waiting items to idle processes, and to new ones up to `jobs`."""
    for worker in workers[:jobs]:
        if waiting and worker.busy is None:
            worker.give(number := waiting.popleft(), items[number])
    while waiting and len(workers) < jobs:
        workers.append(make())
        workers[-1].give(number := waiting.popleft(), items[number])


def _check_alive(in_a_row: int, reason: str) -> None:
    if in_a_row >= DEATHS_IN_A_ROW:
        raise Refused(
            f"workers must stay alive; {in_a_row} died one after the other; of the last: {reason}",
            "make room in memory, or use fewer --jobs",
        )


def _send(pipe: Connection[Any, Any], outgoing: SimpleQueue[bytes | None]) -> None:
    """Send the messages of a queue, then an empty one; a process that does not read blocks only this thread."""
    try:
        while (data := outgoing.get()) is not None:
            pipe.send_bytes(data)
        pipe.send_bytes(b"")
    except OSError:  # it died, which is noticed when its answer is read
        return


def _serve(pipe: Connection[Any, Any], allowance: Allowance) -> None:
    """Main loop of a worker: one item after the other, until an empty message."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent decides
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        function, job = pipe.recv()
        one_thread()
        while data := pipe.recv_bytes():
            item = ForkingPickler.loads(data)
            pipe.send((True, None))
            with limited_memory(allowance.memory_bytes):
                answer = function(item, job)
            pipe.send((False, answer))
    except (EOFError, ConnectionError):
        return


def _end_with_parent() -> None:
    """End with the parent: the next run removes incomplete results."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def one_thread() -> None:
    """Limit OpenCV and numba, if they are loaded, to one thread for calls from this thread."""
    if "cv2" in sys.modules:
        sys.modules["cv2"].setNumThreads(1)
    if "numba" in sys.modules:
        sys.modules["numba"].set_num_threads(1)


@contextmanager
def single_threads() -> Iterator[None]:
    """Limit linear algebra of processes started within the context to one thread."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def without_interrupts() -> Iterator[None]:
    """Block SIGINT in processes started within the context; here it is delivered afterwards."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    ensure_running()  # started by the first process otherwise, and it unblocks the signals
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
