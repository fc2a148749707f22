"""A session's journal as server-sent events: its lines as they are written, each verified against the previous one."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Sequence
from pathlib import Path

from station.common.durable_files import read_own
from station.sessions.journal import parse
from station.sessions.layout import JOURNAL, check_layout, read_config

LOOK_S = 0.25
"""Polling interval of the journal, which any program may write."""
ALIVE_S = 15.0
"""Interval of keep-alive comments in a silent stream."""


def lines_of(folder: Path) -> Sequence[bytes]:
    """The complete lines of a session's journal, verified. Raises BadInput, Damaged."""
    check_layout(folder)
    _, first_sum = read_config(folder)
    path = folder / JOURNAL
    data = read_own(path)
    return data[: parse(data, first_sum, str(path)).length].splitlines()


async def events(
    folder: Path, lines: Sequence[bytes], after: int, *, follow: bool, closing: threading.Event
) -> AsyncIterator[bytes]:
    """The lines after number `after`, then new ones, until `closing` or the end of the journal's folder."""
    silent_s = 0.0
    size = 0
    while True:
        for number, line in enumerate(lines[after:], after + 1):
            yield b"id: %d\ndata: %s\n\n" % (number, line)
            silent_s = 0.0
        after = max(after, len(lines))
        if not follow or closing.is_set():
            return
        await asyncio.sleep(LOOK_S)
        silent_s += LOOK_S
        if silent_s >= ALIVE_S:
            yield b": nothing new\n\n"
            silent_s = 0.0
        try:
            now = (folder / JOURNAL).stat().st_size
        except OSError:
            return
        if now != size:
            size, lines = now, await asyncio.to_thread(lines_of, folder)
