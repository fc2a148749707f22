"""How far a long command is: a bar where a person watches, a line for each step where a file or a program does."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol


class Progress(Protocol):
    """Hears of every step when it is done."""

    def __call__(self, done: str, steps: int = 1) -> None:
        """A sentence about what was done, and how many of the steps it was."""
        ...


def silent(done: str, steps: int = 1) -> None:
    """No progress is shown."""


@contextmanager
def bar(total: int) -> Iterator[Progress]:
    """A bar of `total` steps on stderr that leaves nothing behind."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar
    from rich.table import Column

    sentence = TextColumn("{task.description}", table_column=Column(ratio=1, no_wrap=True, overflow="ellipsis"))
    columns = (BarColumn(20), MofNCompleteColumn(), TimeElapsedColumn(), sentence)
    with Bar(*columns, console=Console(stderr=True), transient=True, expand=True) as shown:
        task = shown.add_task("", total=total)

        def advance(done: str, steps: int = 1) -> None:
            shown.update(task, advance=steps, description=done)

        yield advance
