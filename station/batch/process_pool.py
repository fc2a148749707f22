"""Work shared out to processes that may die: the item that a process dies on is tried once more, then given up.

Processes are spawned: a fork would copy locks that other threads hold. Each computes in one thread: side by side they
use all cores without waiting for each other.
"""

from __future__ import annotations

import os
import signal
import sys
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from typing import Any, Generic, TypeVar

from procedures.outcome import Refused

I = TypeVar("I")  # noqa: E741  (an item)
J = TypeVar("J")
R = TypeVar("R")

TRIES = 2
"""How often an item may end its process: the system kills the largest process, not the guilty one."""
DEATHS_IN_A_ROW = 8
"""So many processes that die one after the other, whatever they work on, do not die of the items."""
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(frozen=True)
class Lost:
    """An item without a result: what became of the process that worked on it."""

    reason: str


@dataclass
class Stop:
    """Asked to stop: what runs is finished, nothing new is begun."""

    asked: bool = False

    def ask(self) -> None:
        """Stop soon."""
        self.asked = True


@dataclass
class _Worker(Generic[I, J, R]):
    """A process, this end of its pipe, and the number of the item it works on."""

    function: Callable[[I, J], R]
    job: J
    busy: int | None = None
    pipe: Connection[Any, Any] = field(init=False)

    def __post_init__(self) -> None:
        context = get_context("spawn")
        self.pipe, other = context.Pipe()
        self.process = context.Process(target=_serve, args=(other, self.function, self.job), daemon=True)
        with single_threads(), without_interrupts():
            self.process.start()
        other.close()

    def give(self, number: int, item: I) -> None:
        """Begin an item; a process that has died meanwhile is found out when its answer is read."""
        self.busy = number
        try:
            self.pipe.send(item)
        except (BrokenPipeError, ConnectionError):
            return

    def answer(self) -> tuple[int, R | Lost]:
        """The number of the item, and what came of it; waits for it."""
        number, self.busy = self.busy or 0, None
        try:
            answer: R = self.pipe.recv()
        except (EOFError, ConnectionError):
            self.end(at_once=False)
            return number, Lost(self._obituary())
        return number, answer

    def _obituary(self) -> str:
        code = self.process.exitcode or 0
        if code < 0:
            return f"the process that worked on it was ended by the system ({signal.Signals(-code).name})"
        return f"the process that worked on it ended by itself (exit code {code})"

    def end(self, at_once: bool) -> None:
        """Let the process go."""
        self.pipe.close()
        if at_once:
            self.process.kill()
        self.process.join()


def run_in_processes(
    function: Callable[[I, J], R], job: J, items: Sequence[I], jobs: int, stop: Stop
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

    Raises
    ------
    Refused
        If processes die without end.
    """
    waiting, deaths, in_a_row = deque(range(len(items))), Counter[int](), 0
    workers: list[_Worker[I, J, R]] = []
    try:
        while True:
            _feed(workers, waiting, items, function, job, 0 if stop.asked else jobs)
            busy = [worker for worker in workers if worker.busy is not None]
            if not busy:
                break
            ready = wait([worker.pipe for worker in busy])
            for worker in (one for one in busy if one.pipe in ready):
                number, answer = worker.answer()
                in_a_row = in_a_row + 1 if isinstance(answer, Lost) else 0
                if isinstance(answer, Lost):
                    workers.remove(worker)
                    _check_alive(in_a_row, answer.reason)
                    deaths[number] += 1
                    if deaths[number] < TRIES:
                        waiting.appendleft(number)
                        continue
                    answer = Lost(f"{answer.reason}, {TRIES} times")
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
    function: Callable[[I, J], R],
    job: J,
    jobs: int,
) -> None:
    """Give what waits to idle processes, and to new ones while there are fewer than `jobs`."""
    for worker in workers[:jobs]:
        if waiting and worker.busy is None:
            worker.give(number := waiting.popleft(), items[number])
    while waiting and len(workers) < jobs:
        workers.append(_Worker(function, job))
        workers[-1].give(number := waiting.popleft(), items[number])


def _check_alive(in_a_row: int, reason: str) -> None:
    if in_a_row >= DEATHS_IN_A_ROW:
        raise Refused(
            f"workers must stay alive; {in_a_row} died one after the other; of the last: {reason}",
            "make room in memory, or use fewer --jobs",
        )


def _serve(pipe: Connection[Any, Any], function: Callable[[Any, Any], Any], job: Any) -> None:
    """A worker's life: one item after the other, until the other end of the pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent decides
    one_thread()
    while True:
        try:
            pipe.send(function(pipe.recv(), job))
        except (EOFError, ConnectionError):
            return


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
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
