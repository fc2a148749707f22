"""The bytes on their way out of one port: orders in their turn, and a stop past all of them.

pyserial's own `write` cannot be called off where a port takes nothing: it tries on for as long as its timeout is, and
what it then gets rid of would follow the stop. Here no lock is held while a port that has a descriptor is waited for.
"""

from __future__ import annotations

import os
import select
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from drivers.wire.connection import anything

WRITE_S = 1.0
"""How long a port may take no bytes."""
URGENT_S = 0.03
"""How long bytes that end a motion wait for a port before its driver takes a harder way to stop."""
HELD_UP_S = 0.005
"""How long a stop waits for an order that is just being given to a port without a descriptor."""
GONE = (OSError, ValueError, TypeError, AttributeError)
"""What ports raise that were unplugged or closed meanwhile."""


class Outgoing:
    """One port's outgoing bytes; from any thread."""

    def __init__(self, port: Any) -> None:
        self._port = port
        self._turn = threading.Lock()
        self._wire = threading.Lock()  # from the question whether an order is allowed until the port has it
        self._stops = 0

    def send(self, data: bytes, allowed: Callable[[], None] = anything, within_s: float = WRITE_S) -> None:
        """Give the port these bytes, in turn. A stop that comes meanwhile drops what is left of them.

        Raises what `allowed` does, TimeoutError where the port takes no bytes `within_s`, OSError where it is gone.
        """
        deadline_s = time.monotonic() + within_s
        if not self._turn.acquire(timeout=within_s):
            raise TimeoutError(f"earlier bytes were not taken within {within_s:g} s")
        try:
            stops = self._stops
            rest = self._give(data, stops, allowed)
            while rest:
                if not _room(self._port, deadline_s):
                    self._drop_unsent()
                    raise TimeoutError(f"it took no bytes for {within_s:g} s")
                rest = self._give(rest, stops)
        finally:
            self._turn.release()

    def _give(self, data: bytes, stops: int, allowed: Callable[[], None] = anything) -> bytes:
        """What the port did not take."""
        with self._wire:
            allowed()
            return _put(self._port, data) if self._stops == stops else b""

    def stop(self, data: bytes) -> bool:
        """Drop what was not sent yet, then give the port these bytes; whether it took them. Never raises."""
        self._stops += 1
        held = self._wire.acquire(timeout=HELD_UP_S)
        try:
            self._drop_unsent()
            rest, deadline_s = _put(self._port, data), time.monotonic() + WRITE_S
            while rest and _room(self._port, deadline_s):
                rest = _put(self._port, rest)
            return not rest
        except GONE:
            return False
        finally:
            if held:
                self._wire.release()

    def _drop_unsent(self) -> None:
        """Take back what the port was given and has not sent."""
        with suppress(Exception):  # a port that is gone, or of a kind that keeps nothing back
            self._port.reset_output_buffer()


def _put(port: Any, data: bytes) -> bytes:
    """Give a port bytes without waiting where it has a descriptor; what it did not take."""
    descriptor = getattr(port, "fd", None)
    if descriptor is None:
        port.write(data)
        return b""
    try:
        return data[os.write(descriptor, data) :]
    except BlockingIOError:
        return data


def _room(port: Any, deadline_s: float) -> bool:
    """Wait until the port takes bytes again; False where it did not by the deadline."""
    return bool(select.select([], [port.fd], [], max(deadline_s - time.monotonic(), 0.0))[1])
