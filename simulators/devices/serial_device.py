"""A cable with a byte-level device at its end, behind `sim://BENCH/DEVICE` and whatever else wants to read it.

A device is told bytes and the time, and asked what it has said by now; it has no thread. The cable delivers, and
spoils on request what it delivers.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Protocol

from simulators.devices.cable_faults import Faults
from simulators.world.clock import FastClock, VirtualClock

SimClock = FastClock | VirtualClock


class SerialDevice(Protocol):
    """What is at the end of the cable."""

    baud: int

    def receive(self, data: bytes, now_s: float) -> None:
        """Bytes from the host."""
        ...

    def set_lines(self, rts: bool, dtr: bool, now_s: float) -> None:
        """Modem lines, set by the host; opening the port raises both."""
        ...

    def advance(self, now_s: float) -> bytes:
        """Live until now; what was said meanwhile."""
        ...

    def next_event_s(self) -> float | None:
        """When it next says or does something by itself."""
        ...


def taken(out: bytearray) -> bytes:
    """What has been said, which is said once."""
    said = bytes(out)
    out.clear()
    return said


class PortInUse(OSError):
    """A second program opens the port."""


class Unplugged(OSError):
    """The cable is out."""


class Cable:
    """One serial line: bytes both ways, one reader at a time, faults."""

    def __init__(self, device: SerialDevice, clock: SimClock, faults: Faults | None = None) -> None:
        self.device = device
        self.clock = clock
        self.faults = faults or Faults()
        self._news = threading.Condition()
        self._inbox = bytearray()
        self._owner: object | None = None
        self._reading = False
        self._baud_ok = True
        clock.attach(self)

    def open(self, owner: object, baud: int) -> None:
        """Own the line. Raises PortInUse, Unplugged."""
        with self._news:
            if self.faults.unplugged(self.clock.now_s()):
                raise Unplugged("no such device")
            if self._owner is not None:
                raise PortInUse("could not exclusively lock port: resource temporarily unavailable")
            self._owner, self._reading = owner, False
            self._baud_ok = baud == self.device.baud or self.device.baud == 0
            self._pump()
            self._inbox.clear()

    def close(self, owner: object) -> None:
        """Let go; unread bytes are lost."""
        with self._news:
            if self._owner is owner:
                self._owner, self._reading = None, False
            self._news.notify_all()

    def set_lines(self, rts: bool, dtr: bool) -> None:
        """Modem lines, from the host."""
        with self._news:
            self._pump()
            self.device.set_lines(rts, dtr, self.clock.now_s())
            self._pump()

    def write(self, data: bytes) -> None:
        """Bytes to the device. Raises Unplugged."""
        with self._news:
            self._pump()
            now_s = self.clock.now_s()
            self._check_plug(now_s)
            heard = self.faults.spoil(data, now_s) if self._baud_ok else self.faults.scramble(data)
            if heard:
                self.device.receive(heard, now_s)
                self._pump()

    def happen(self, act: Callable[[float], None]) -> None:
        """Let something happen to the device now."""
        with self._news:
            self._pump()
            act(self.clock.now_s())
            self._pump()

    def waiting(self) -> int:
        """How many bytes can be read now."""
        with self._news:
            return len(self._inbox)

    def read(self, owner: object, size: int, real_s: float | None) -> bytes:
        """Up to `size` bytes; waits for the first of them, at most `real_s` of real time. Raises Unplugged."""
        with self._news:
            self._pump()
            if not self._inbox and self._owner is owner:
                self._reading = True
                self._news.notify_all()
                self._news.wait(self._patience(real_s))
                self._reading = False
                self._pump()
            self._check_plug(self.clock.now_s())
            taken = bytes(self._inbox[:size])
            del self._inbox[:size]
            return taken

    def _patience(self, real_s: float | None) -> float | None:
        moment_s = self.next_event_s()
        own_s = None if moment_s is None else self.clock.real_s(moment_s)
        return min((wait for wait in (real_s, own_s) if wait is not None), default=None)

    def cancel_read(self) -> None:
        """Wake the reader."""
        with self._news:
            self._news.notify_all()

    def _check_plug(self, now_s: float) -> None:
        if self.faults.unplugged(now_s):
            raise Unplugged("device reports readiness to read but returned no data (device disconnected?)")

    def _pump(self) -> None:
        """Take from the device what it has said by now."""
        now_s = self.clock.now_s()
        said = self.device.advance(now_s)
        if said:
            said = self.faults.spoil_reply(said, now_s) if self._baud_ok else self.faults.scramble(said)
        said += self.faults.late(now_s)
        if said and self._owner is not None and not self.faults.unplugged(now_s):
            self._inbox += said
            self._reading = False
            self._news.notify_all()

    def next_event_s(self) -> float | None:
        """When the device, or a delayed byte, comes next; a device nobody listens to lives on when it is asked."""
        if self._owner is None:
            return None
        moments = (self.device.next_event_s(), self.faults.next_event_s(self.clock.now_s()))
        return min((moment for moment in moments if moment is not None), default=None)

    def wake(self) -> None:
        """Be up to date with the clock."""
        with self._news:
            self._pump()
            if self.faults.unplugged(self.clock.now_s()):
                self._news.notify_all()

    def settled(self) -> bool:
        """Whether nobody has bytes left to read."""
        with self._news:
            return self._settled()

    def _settled(self) -> bool:
        there = not self.faults.unplugged(self.clock.now_s())  # a reader that lost its line closes the port
        return self._owner is None or (self._reading and not self._inbox and there)

    def settle(self, real_s: float) -> None:
        """Wait until settled, at most `real_s` seconds of real time."""
        with self._news:
            self._news.wait_for(self._settled, real_s)


_cables: dict[str, Cable] = {}


def plug(address: str, cable: Cable) -> None:
    """Make the cable reachable as `sim://address` in this process."""
    _cables[address] = cable


def unplug(address: str) -> None:
    """Take the address away."""
    _cables.pop(address, None)


def cable_at(address: str) -> Cable:
    """The cable of that address. Raises OSError if there is none."""
    if address not in _cables:
        raise OSError(f"no simulated device at sim://{address}; open its bench first")
    return _cables[address]
