"""A cable with a byte-level device at its end, reachable as `sim://BENCH/DEVICE` or through other adapters.

A device receives bytes with their time, and returns its output up to a time; it has no thread. The cable delivers
the bytes, with faults on request.
"""

import threading
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

import numpy as np

from simulators.world.clock import FastClock, VirtualClock
from simulators.world.motion import Axis, brake_line, travel_line

SimClock = FastClock | VirtualClock


class SerialDevice(Protocol):
    """A device at the end of a cable."""

    baud: int

    def receive(self, data: bytes, now_s: float) -> None:
        """Bytes from the host."""

    def set_lines(self, rts: bool, dtr: bool, now_s: float) -> None:
        """Modem lines set by the host; opening the port raises both. Ignored by devices without modem lines."""
        return

    def advance(self, now_s: float) -> bytes:
        """Advance to now; returns the output since the last call."""

    def next_event_s(self) -> float | None:
        """When it next sends or does something by itself; None if never."""
        return None


def drained(out: bytearray) -> bytes:
    """Return and clear the output buffer."""
    output = bytes(out)
    out.clear()
    return output


class PortInUse(OSError):
    """A second program opens the port."""


class Unplugged(OSError):
    """The cable is disconnected."""


class Cable:
    """One serial line: bytes both ways, one reader at a time, faults."""

    def __init__(self, device: SerialDevice, clock: SimClock, faults: "Faults | None" = None) -> None:
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
        """Release the line; unread bytes are lost."""
        with self._news:
            if self._owner is owner:
                self._owner, self._reading = None, False
            self._news.notify_all()

    def set_lines(self, rts: bool, dtr: bool) -> None:
        """Modem lines set by the host."""
        with self._news:
            self._pump()
            self.device.set_lines(rts, dtr, self.clock.now_s())
            self._pump()

    def write(self, data: bytes) -> None:
        """Bytes to the device. Raises Unplugged, and TimeoutError while the port is clogged."""
        with self._news:
            self._pump()
            now_s = self.clock.now_s()
            self._check_plug(now_s)
            if self.faults.is_clogged(now_s):
                raise TimeoutError("the port takes no bytes")
            received = self.faults.spoil(data, now_s) if self._baud_ok else self.faults.scramble(data)
            if received:
                self.device.receive(received, now_s)
                self._pump()

    def happen(self, act: Callable[[float], None]) -> None:
        """Apply an external event to the device now."""
        with self._news:
            self._pump()
            act(self.clock.now_s())
            self._pump()

    def waiting(self) -> int:
        """Number of bytes that can be read now."""
        with self._news:
            return len(self._inbox)

    def read(self, owner: object, size: int, real_s: float | None) -> bytes:
        """Up to `size` bytes; waits at most `real_s` of real time for the first. Raises Unplugged."""
        with self._news:
            self._pump()
            if not self._inbox and self._owner is owner:
                self._reading = True
                self._news.notify_all()
                moment_s = self.next_event_s()
                own_s = None if moment_s is None else self.clock.real_s(moment_s)
                patience = min((wait for wait in (real_s, own_s) if wait is not None), default=None)
                self._news.wait(patience)
                self._reading = False
                self._pump()
            self._check_plug(self.clock.now_s())
            drained = bytes(self._inbox[:size])
            del self._inbox[:size]
            return drained

    def cancel_read(self) -> None:
        with self._news:
            self._news.notify_all()

    def _check_plug(self, now_s: float) -> None:
        if self.faults.unplugged(now_s):
            raise Unplugged("device reports readiness to read but returned no data (device disconnected?)")

    def _pump(self) -> None:
        now_s = self.clock.now_s()
        output = self.device.advance(now_s)
        if output:
            output = self.faults.spoil_reply(output, now_s) if self._baud_ok else self.faults.scramble(output)
        output += self.faults.late(now_s)
        if output and self._owner is not None and not self.faults.unplugged(now_s):
            self._inbox += output
            self._reading = False
            self._news.notify_all()

    def next_event_s(self) -> float | None:
        """When the device or a delayed byte acts next; None while the port is closed."""
        if self._owner is None:
            return None
        moments = (self.device.next_event_s(), self.faults.next_event_s(self.clock.now_s()))
        return min((moment for moment in moments if moment is not None), default=None)

    def wake(self) -> None:
        with self._news:
            self._pump()
            if self.faults.unplugged(self.clock.now_s()):
                self._news.notify_all()

    def settled(self) -> bool:
        """Whether no reader has unread bytes."""
        with self._news:
            return self._settled()

    def _settled(self) -> bool:
        there = not self.faults.unplugged(self.clock.now_s())  # a reader whose line is lost closes the port
        return self._owner is None or (self._reading and not self._inbox and there)

    def settle(self, real_s: float) -> None:
        """Wait until settled, at most `real_s` seconds of real time."""
        with self._news:
            self._news.wait_for(self._settled, real_s)


_cables: dict[str, Cable] = {}


def plug(address: str, cable: Cable) -> None:
    """Register the cable as `sim://address` in this process."""
    _cables[address] = cable


def unplug(address: str) -> None:
    """Remove the address."""
    _cables.pop(address, None)


def cable_at(address: str) -> Cable:
    """The cable of this address. Raises OSError if there is none."""
    if address not in _cables:
        raise OSError(f"no simulated device at sim://{address}; open its bench first")
    return _cables[address]


# --- Faults of a cable, on request or at random from a seed ---


@dataclass
class Faults:
    """Faults of one cable. Probabilities are per byte, except `duplicate`, which is per chunk.

    `silent`: spans of seconds in which nothing passes; `clogged`: in which the port takes no bytes; `delay_s`: delay of
    every reply, up to `jitter_s` longer at random; `slip`: a reply comes only when the next one is due;
    `unplugged_at_s`, `replugged_at_s`: when the cable is disconnected and reconnected; `wrong_baud`: all is noise.
    """

    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    lost: float = 0.0
    garbage: float = 0.0
    duplicate: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0
    slip: bool = False
    silent: tuple[tuple[float, float], ...] = ()
    clogged: tuple[tuple[float, float], ...] = ()
    unplugged_at_s: float = float("inf")
    replugged_at_s: float = float("inf")
    wrong_baud: bool = False
    begin_s: float = 0.0
    _late: deque[tuple[float, bytes]] = field(default_factory=deque)
    _held: bytes = b""

    def unplugged(self, now_s: float) -> bool:
        """Whether the cable is disconnected."""
        return self.unplugged_at_s <= now_s < self.replugged_at_s

    def is_clogged(self, now_s: float) -> bool:
        """Whether the port takes no bytes."""
        return any(begin <= now_s < end for begin, end in self.clogged)

    def scramble(self, data: bytes) -> bytes:
        """The bytes received at a wrong baud rate: noise of the same length or slightly shorter."""
        keep = self.rng.random(len(data)) < 0.8
        return self.rng.integers(0, 256, int(keep.sum()), dtype=np.uint8).tobytes()

    def spoil(self, data: bytes, now_s: float) -> bytes:
        """The part of `data` that arrives now, with its errors."""
        if self.wrong_baud:
            return self.scramble(data)
        if any(begin <= now_s < end for begin, end in self.silent):
            return b""
        if now_s < self.begin_s or not (self.lost or self.garbage or self.duplicate):
            return data
        draws = self.rng.random(len(data))
        noise = self.rng.integers(0, 256, len(data), dtype=np.uint8)
        kept = bytearray()
        for byte, draw, other in zip(data, draws, noise, strict=True):
            if draw < self.lost:
                continue
            kept.append(int(other) if draw < self.lost + self.garbage else byte)
        return bytes(kept) * (2 if self.rng.random() < self.duplicate else 1)

    def spoil_reply(self, data: bytes, now_s: float) -> bytes:
        """The part of a reply that arrives now; nothing if replies are delayed."""
        spoilt = self.spoil(data, now_s)
        if spoilt and self.slip:
            self._held, spoilt = spoilt, self._held
        if self.delay_s and spoilt and now_s >= self.begin_s:
            due_s = now_s + self.delay_s + (self.rng.uniform(0.0, self.jitter_s) if self.jitter_s else 0.0)
            self._late.append((max([due_s, *(moment for moment, _ in self._late)]), spoilt))
            return b""
        return spoilt

    def late(self, now_s: float) -> bytes:
        """Delayed bytes that are due."""
        due = b""
        while self._late and self._late[0][0] <= now_s:
            due += self._late.popleft()[1]
        return due

    def next_event_s(self, now_s: float) -> float | None:
        """When a delayed byte arrives or the plug state changes."""
        moments = [self._late[0][0]] if self._late else []
        moments += [moment for moment in (self.unplugged_at_s, self.replugged_at_s) if now_s < moment < float("inf")]
        return min(moments, default=None)


# --- A motor with a reference switch at the low end of its axis, and what controllers of such motors have in common ---

NEVER = float("inf")
K = TypeVar("K", bound=Hashable)


class Motor:
    """One motor; after a power cycle it takes its place for 0.

    `referenced` is lost by a power cycle and by an interrupted search; `homing` is true during a search.
    """

    def __init__(self, axis: Axis, speed: float = 20.0, acceleration: float = 200.0) -> None:
        self.axis, self.speed, self.acceleration = axis, speed, acceleration
        self.referenced, self.homing = False, False
        self.rest_s = NEVER
        self.place_of_zero = axis.position(0.0)

    def position(self, now_s: float) -> float:
        return self.axis.position(now_s) - self.place_of_zero

    def moves(self) -> bool:
        """Whether it has not yet arrived."""
        return self.rest_s != NEVER

    def go(self, position: float, now_s: float) -> None:
        """Drive to an assumed position, not beyond the ends of the axis."""
        place = min(max(position + self.place_of_zero, self.axis.low), self.axis.high)
        self.axis.halt(now_s)
        self.homing = False
        self.rest_s = travel_line([self.axis], [place], now_s, self.speed, self.acceleration)

    def home(self, now_s: float) -> None:
        self.go(self.axis.low - self.place_of_zero, now_s)
        self.referenced, self.homing = False, True

    def stop(self, now_s: float) -> None:
        """Decelerate and stay; a search is given up."""
        self.homing = False
        if self.moves():
            self.rest_s = brake_line([self.axis], now_s, self.acceleration)

    def restart(self, now_s: float) -> None:
        """Off and on again: it stops at once."""
        self.axis.halt(now_s)
        self.referenced, self.homing, self.rest_s = False, False, NEVER
        self.place_of_zero = self.axis.position(now_s)

    def advance(self, now_s: float) -> None:
        """End a drive; after a search, its place is 0."""
        if self.rest_s <= now_s:
            self.rest_s = NEVER
            if self.homing:
                self.referenced, self.homing, self.place_of_zero = True, False, self.axis.low


class MotorController(SerialDevice, Generic[K]):
    """A controller of motors by their numbers or identifiers at it."""

    def __init__(self, axes: Mapping[str, Axis], numbers: Iterable[K], speed: float = 20.0) -> None:
        self.axes = dict(axes)
        self.motors = {number: Motor(axis, speed) for number, axis in zip(numbers, self.axes.values(), strict=False)}
        self._received, self._out = bytearray(), bytearray()

    def restart(self, now_s: float) -> None:
        for motor in self.motors.values():
            motor.restart(now_s)
        self._received.clear()

    def advance(self, now_s: float) -> bytes:
        """Drives that have ended, and the output."""
        for motor in self.motors.values():
            motor.advance(now_s)
        return drained(self._out)

    def next_event_s(self) -> float | None:
        """The end of the next drive."""
        moment_s = min(motor.rest_s for motor in self.motors.values())
        return None if moment_s == NEVER else moment_s
