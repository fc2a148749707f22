"""Progress of a command, on the terminal or in the log."""

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
    """A bar on a terminal, lines otherwise."""
    from station.common.progress import bar

    if sys.stderr.isatty() and not logs_json():
        with bar(total) as shown:
            yield shown
    else:
        yield lambda done, steps=1: log("step", done)
