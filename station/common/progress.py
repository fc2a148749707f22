"""Progress of a long command: a bar on a terminal, a line for each step in a file or for a program."""

import os
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Protocol


class Progress(Protocol):
    """Callback for every finished step."""

    def __call__(self, done: str, steps: int = 1) -> None:
        """`done` describes what was finished, `steps` how many steps it was."""


def silent(done: str, steps: int = 1) -> None:
    """No-op progress callback."""


@contextmanager
def bar(total: int) -> Iterator[Progress]:
    """A bar of `total` steps on stderr that is erased at the end."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar
    from rich.table import Column

    sentence = TextColumn("{task.description}", table_column=Column(ratio=1, no_wrap=True, overflow="ellipsis"))
    columns = (BarColumn(20), MofNCompleteColumn(), TimeElapsedColumn(), sentence)
    with Bar(*columns, console=Console(stderr=True), transient=True, expand=True) as shown:
        task = shown.add_task("working", total=total if total > 1 else None)  # one step: it moves to and fro

        def advance(done: str, steps: int = 1) -> None:
            shown.update(task, advance=steps, description=done)

        yield advance


class StepRate:
    """Rate of the last steps, and the remaining time."""

    LAST = 30
    """Number of steps over which the rate is measured."""

    def __init__(self, total: int, clock: Callable[[], float]) -> None:
        self.total, self.done = total, 0
        self._clock = clock
        self._times = deque([clock()], maxlen=self.LAST + 1)

    def step(self) -> str:
        """Count a step; returns the rate and the remaining time: 5.1/s, 1:12 left."""
        self.done += 1
        self._times.append(self._clock())
        elapsed = self._times[-1] - self._times[0]
        if elapsed <= 0:
            return "at once"
        rate = (len(self._times) - 1) / elapsed
        left = round((self.total - self.done) / rate)
        clock = (
            f"{left // 3600}:{left % 3600 // 60:02d}:{left % 60:02d}"
            if left >= 3600
            else f"{left // 60}:{left % 60:02d}"
        )
        return f"{rate:.1f}/s, {clock} left" if rate >= 0.95 else f"{1 / rate:.1f} s each, {clock} left"


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
