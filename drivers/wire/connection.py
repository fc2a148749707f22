"""Common operations of drivers on their line: open it or leave it closed, identify devices, report its state."""

import os
import select
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, Generic, TypeVar

from drivers.errors import Clock, DeviceError, LineLost, NoAnswer, SystemClock
from drivers.interfaces import Condition, Line, Transport

E = TypeVar("E")
T = TypeVar("T")
L = TypeVar("L", bound=Line)


def anything() -> None:
    """Allow every order: the default of `allowed`."""


@contextmanager
def opened(transport: Transport[E], listen: Callable[[E, float], None] = lambda event, host_s: None) -> Iterator[None]:
    """Open the line for the first requests; close it again if one of them fails."""
    transport.open(listen)
    try:
        yield
    except DeviceError:
        transport.close()
        raise


def not_connected(address: str) -> LineLost:
    """The error for a request before `connect`."""
    return LineLost(f"{address} is not connected", "connect first")


def roll_call(numbers: Iterable[int], ask: Callable[[int], T], where: str, remedy: str) -> list[T]:
    """Identify every device of a shared line. Raises NoAnswer naming all that are missing.

    `where` is the port and the kind of devices: "/dev/ttyUSB0: no answer from devices".
    """
    answers, missing = [], []
    for number in dict.fromkeys(numbers):
        try:
            answers.append(ask(number))
        except NoAnswer:
            missing.append(str(number))
    if missing:
        raise NoAnswer(f"{where} {', '.join(missing)}", remedy)
    return answers


def line_condition(is_open: bool, word: str = "ready") -> Condition:
    """The condition of a device with or without its line."""
    return Condition(word) if is_open else Condition("not connected", False, "connect it")


class LineDevice(Generic[L]):
    """A driver that has a line: its address, its condition, and its release."""

    def __init__(self, line: L, clock: Clock | None = None) -> None:
        self.clock = clock or SystemClock()
        self._transport = line

    @property
    def address(self) -> str:
        return self._transport.address

    @property
    def _word(self) -> str:
        """The state while it is connected."""
        return "ready"

    def condition(self) -> Condition:
        """The state, or that it is not connected."""
        return line_condition(self._transport.is_open, self._word)

    def close(self) -> None:
        """Release the line; the device keeps its settings."""
        self._transport.close()


# --- The outgoing bytes of one port: orders in turn, and stops before all of them ---
# pyserial's own `write` cannot be cancelled when a port accepts nothing: it retries until its timeout, and
# what it then writes would follow the stop. Here no lock is held while waiting for a port with a descriptor.

WRITE_S = 1.0
"""Time limit for a port to accept bytes."""
URGENT_S = 0.03
"""How long bytes that end a motion wait for a port before the driver stops by stronger means."""
STOP_TRIES = 6
"""How often a stop is offered to a port that takes no bytes, each time for `WRITE_S`: what moves goes on meanwhile."""
HELD_UP_S = 0.005
"""How long a stop waits for an order that is being written to a port without a descriptor."""
GONE = (OSError, ValueError, TypeError, AttributeError)
"""Exceptions of ports that were unplugged or closed meanwhile."""


class Outgoing:
    """One port's outgoing bytes; thread-safe."""

    def __init__(self, port: Any) -> None:
        self._port = port
        self._turn = threading.Lock()
        self._wire = threading.Lock()  # from the check that an order is allowed until the port has it
        self._stops = 0

    def send(self, data: bytes, allowed: Callable[[], None] = anything, within_s: float = WRITE_S) -> None:
        """Write these bytes in turn. A stop that comes meanwhile drops the remainder.

        Raises what `allowed` raises, TimeoutError if the port takes no bytes `within_s`, OSError if it is gone.
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
        """The bytes that the port did not accept."""
        with self._wire:
            allowed()
            return _put(self._port, data) if self._stops == stops else b""

    def stop(self, data: bytes) -> bool:
        """Drop unsent bytes, then write these; returns whether the port accepted them. Never raises."""
        self._stops += 1
        held = self._wire.acquire(timeout=HELD_UP_S)
        try:
            self._drop_unsent()
            return any(self._stopped(data) for _ in range(STOP_TRIES))
        finally:
            if held:
                self._wire.release()

    def _stopped(self, data: bytes) -> bool:
        """Whether the port takes these bytes within `WRITE_S`; one that is clogged may take them later."""
        try:
            rest, deadline_s = _put(self._port, data), time.monotonic() + WRITE_S
            while rest and _room(self._port, deadline_s):
                rest = _put(self._port, rest)
            return not rest
        except GONE:
            return False

    def _drop_unsent(self) -> None:
        """Discard what the port has buffered and not sent."""
        with suppress(Exception):  # a port that is gone, or one without a buffer
            self._port.reset_output_buffer()


def _put(port: Any, data: bytes) -> bytes:
    """Write without waiting if the port has a descriptor; returns the bytes not accepted."""
    descriptor = getattr(port, "fd", None)
    if descriptor is None:
        port.write(data)
        return b""
    try:
        return data[os.write(descriptor, data) :]
    except BlockingIOError:
        return data


def _room(port: Any, deadline_s: float) -> bool:
    """Wait until the port accepts bytes again; False if it did not by the deadline."""
    return bool(select.select([], [port.fd], [], max(deadline_s - time.monotonic(), 0.0))[1])
