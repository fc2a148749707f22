"""Progress of a command, on the terminal or in the log."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeVar

from station.common.errors import log, log_json_option, quiet_option

if TYPE_CHECKING:
    from station.common.progress import Progress


T = TypeVar("T")
PATIENCE_S = 5.0
"""Interval of lines about work within a step, where there is no terminal."""


@contextmanager
def progress(total: int) -> Iterator[Progress]:
    """A bar on a terminal, lines otherwise; nothing where the command is quiet."""
    from station.common.progress import bar, silent

    if quiet_option.given():
        yield silent
    elif sys.stderr.isatty() and not log_json_option.given():
        with bar(total) as shown:
            yield shown
    else:
        yield step_lines()


def awaited(words: str, items: Iterable[T]) -> Iterator[T]:
    """The items, with a bar while each is computed; lines may be written in between."""
    iterator = iter(items)
    while True:
        with progress(1) as shown:
            shown(words, 0)
            one = next(iterator, None)
        if one is None:
            return
        yield one


def step_lines(clock: Callable[[], float] = time.monotonic) -> Progress:
    """A line for every finished step, and at intervals for what is finished within one."""
    last = clock()

    def line(done: str, steps: int = 1) -> None:
        nonlocal last
        if steps or clock() - last > PATIENCE_S:
            last = clock()
            log("step", done)

    return line
