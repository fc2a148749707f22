"""Work shared out to processes that may die: the item that a process dies on is tried once more, then given up.

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
from queue import SimpleQueue
from typing import Any, Generic, TypeVar

from procedures.outcome import Refused
from station.batch.allowance import Allowance, is_stopped, limited_memory

I = TypeVar("I")  # noqa: E741  (an item)
J = TypeVar("J")
R = TypeVar("R")

TRIES = 2
"""How often an item may end its process: the system kills the largest process, not the guilty one."""
DEATHS_IN_A_ROW = 8
"""So many processes that die one after the other, whatever they work on, do not die of the items."""
POLL_S = 0.5
"""Between two looks at processes that work."""
STOPPED_S = 2.0
"""A process that is stopped for so long is ended; Ctrl-Z stops parent and children alike, and `fg` lets all go on."""
GOING_S = 5.0
"""An idle process whose pipe is closed goes at once; after so long it is ended."""
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(frozen=True)
class Lost:
    """An item without a result: what became of the process that worked on it."""

    reason: str


NO_LIMIT = Allowance()


@dataclass
class Stop:
    """Asked to stop: what runs is finished, nothing new is begun."""

    asked: bool = False

    def ask(self) -> None:
        """Stop soon."""
        self.asked = True


@dataclass
class _Worker(Generic[I, J, R]):
    """A process, this end of its pipe, the item it works on by number, and since when it does, or is stopped."""

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
        # little enough for a pipe: starting a process that is stopped before it reads would wait for it
        self.process = context.Process(target=_serve, args=(other, self.allowance), daemon=True)
        with single_threads(), without_interrupts():
            self.process.start()
        other.close()
        self._outgoing: SimpleQueue[bytes | None] = SimpleQueue()
        self._sender = threading.Thread(target=_send, args=(self.pipe, self._outgoing), daemon=True)
        self._sender.start()
        self._outgoing.put(bytes(ForkingPickler.dumps((self.function, self.job))))

    def give(self, number: int, item: I) -> None:
        """Begin an item; a process that has died meanwhile is found out when its answer is read."""
        self.busy, self.since_s, self.stopped_s = number, None, None
        self._outgoing.put(bytes(ForkingPickler.dumps(item)))

    def answer(self) -> tuple[int, R | Lost] | None:
        """The number of the item, and what came of it; None where it has only been begun now."""
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
        """End the process where it has worked for too long, or is stopped: then its pipe has an end to be read."""
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
        """Whether it was ended for its time, which another try would take again."""
        return self.fault.startswith("it took longer")

    def _obituary(self) -> str:
        if self.fault:
            return self.fault
        code = self.process.exitcode or 0
        if code < 0:
            return f"the process that worked on it was ended by the system ({signal.Signals(-code).name})"
        return f"the process that worked on it ended by itself (exit code {code})"

    def end(self, at_once: bool) -> None:
        """Let the process go."""
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
    """`function(item, job)` of every item, as they are finished, each with its item's number.

    Parameters
    ----------
    function : callable
        One that another process finds by its name.
    jobs : int
        Processes at a time.
    stop : Stop
        When it is asked to, what runs is finished and the rest is left out.
    allowance : Allowance
        What each item may take; a process that takes longer, or is stopped, is ended.

    Raises
    ------
    Refused
        If processes die without end.
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
                if (told := worker.answer()) is None:
                    continue
                number, answer = told
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
    workers: list[_Worker[I, J, R]],
    waiting: deque[int],
    items: Sequence[I],
    make: Callable[[], _Worker[I, J, R]],
    jobs: int,
) -> None:
    """Give what waits to idle processes, and to new ones while there are fewer than `jobs`."""
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
    """Send what comes, and an empty message at its end; who takes nothing holds this thread, and nothing else."""
    try:
        while (data := outgoing.get()) is not None:
            pipe.send_bytes(data)
        pipe.send_bytes(b"")
    except OSError:  # it has died, which is found out when its answer is read
        return


def _serve(pipe: Connection[Any, Any], allowance: Allowance) -> None:
    """A worker's life: one item after the other, until nothing more comes."""
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
    """End where the parent was killed: nobody takes the answers, and the next run removes what is half written."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def one_thread() -> None:
    """Have OpenCV and numba, where the work has loaded them, compute in one thread from the calling thread."""
    if "cv2" in sys.modules:
        sys.modules["cv2"].setNumThreads(1)
    if "numba" in sys.modules:
        sys.modules["numba"].set_num_threads(1)


@contextmanager
def single_threads() -> Iterator[None]:
    """Processes started within have one thread for linear algebra."""
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
    """Processes started within never hear of Ctrl-C; one pressed meanwhile is heard here afterwards."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    ensure_running()  # the first start of a process would start it, and it leaves the signals unblocked
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
