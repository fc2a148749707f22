"""Ctrl-C and SIGTERM while devices are open: the first Ctrl-C asks to stop, the second and SIGTERM stop at once."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

EXIT_DEVICE = 3
"""The exit code after an emergency stop."""


@contextmanager
def guarded(
    emergency_stop: Callable[[], None], ask_to_stop: Callable[[], None], *, terminated: int = EXIT_DEVICE
) -> Iterator[None]:
    """Within, SIGTERM and a second Ctrl-C stop the bench and end the program; the first Ctrl-C only asks.

    Must be entered in the main thread, where Python handles signals; `emergency_stop` waits for no lock. `terminated`
    is the exit code after SIGTERM.
    """
    asked = False

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal asked
        if asked:
            emergency_stop()
            raise KeyboardInterrupt
        asked = True
        ask_to_stop()

    def terminate(number: int, frame: FrameType | None) -> None:
        emergency_stop()
        raise SystemExit(terminated)

    before = signal.signal(signal.SIGINT, interrupt), signal.signal(signal.SIGTERM, terminate)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before[0])
        signal.signal(signal.SIGTERM, before[1])
