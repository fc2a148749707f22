"""How far a command is, as the terminal or the log takes it."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from station.common.log import log, logs_json

if TYPE_CHECKING:
    from station.common.progress import Progress


@contextmanager
def progress(total: int) -> Iterator[Progress]:
    """A bar where a person watches, lines otherwise."""
    from station.common.progress import bar

    if sys.stderr.isatty() and not logs_json():
        with bar(total) as shown:
            yield shown
    else:
        yield lambda done, steps=1: log("step", done)
