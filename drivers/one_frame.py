"""Rule of all cameras that wait for their frames: one exposure at a time, and a stop ends it."""

from __future__ import annotations

import threading
from collections.abc import Callable

from drivers.errors import EmergencyStopped, Rejected


class OneFrame:
    """Context of an exposure of the camera at `address()`; a second one is refused at once."""

    def __init__(self, address: Callable[[], str]) -> None:
        self._address = address
        self._lock = threading.Lock()
        self._stops = self._since = 0

    def __enter__(self) -> OneFrame:
        if not self._lock.acquire(blocking=False):
            raise Rejected(f"{self._address()} is already exposing", "wait for the frame")
        self._since = self._stops
        return self

    def __exit__(self, *_: object) -> None:
        self._lock.release()

    def stop(self) -> None:
        """Record a stop, without waiting."""
        self._stops += 1

    def check(self) -> None:
        """Raises EmergencyStopped if a stop came since the exposure began."""
        if self._stops != self._since:
            raise EmergencyStopped(f"emergency stop at {self._address()}", "make it safe, then expose again")
