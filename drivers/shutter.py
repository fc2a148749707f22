"""Three ways to close a camera's release contact: a STRIG box, a bare RTS line, the relay of a GRBL controller.

The protocol and its firmware are described in `firmware/STRIG.md`. Only the box reports the actual closing time of the
contact; the others report the time of the command.
"""

import re
import struct
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial, reduce
from operator import xor
from typing import ClassVar

from drivers.errors import (
    BadConfiguration,
    Clock,
    DeviceError,
    EmergencyStopped,
    LineLost,
    MoveFailed,
    NoAnswer,
    Rejected,
)
from drivers.interfaces import Identity, ShutterTimes, Transport
from drivers.making import DriverOptions, LineOptions, MakerContext, OutputOptions
from drivers.move_checks import left_still
from drivers.options import SHUTTER, STRIG_BOX, Port
from drivers.protocols.framing import LineSplitter, UnrecognisedLine
from drivers.protocols.grbl_link import GrblLink, GrblOutput
from drivers.wire.connection import L, LineDevice, anything, opened

ABORT = b"\nABORT\n"  # the first newline ends an unfinished line
REPLY_S = 0.5
BOOT_S = 3.0  # boot loader and start of an Arduino, which resets when its port is opened
AGAIN_S = 0.05  # before it is asked again: a port that takes no bytes may fail at once
KEEP_ALIVE_S = 2.0  # the box opens its contacts after five silent seconds
TOLERANCE_S = 0.005
FLASH_S = 1.0  # longest time from the opening of the contacts to the hot shoe: lag of the body's shutter
DRIFT = 1e-4  # bound of the relative error of a crystal
REFUSALS = {
    3: "wait for the shot, or abort it",
    4: "wire a shaker to the box, or remove it from station.toml",
    5: "wire an inertial unit to the box, or remove it from station.toml",
}
"""Remedies, by the box's error number."""


@dataclass(frozen=True)
class Hello:
    """`STRIG/1 board firmware serial`, or another version of the protocol."""

    board: str
    firmware: str
    serial: str
    version: int = 1


@dataclass(frozen=True)
class Accepted:
    """`OK seq`."""

    seq: int


@dataclass(frozen=True)
class Refusal:
    """`ERR code text`."""

    code: int
    text: str


@dataclass(frozen=True)
class Contact:
    """`EVT kind seq t_us`; FLASH carries no number, its seq is 0."""

    kind: str
    seq: int
    t_us: int


@dataclass(frozen=True)
class BoxTime:
    """`SYNC t_us tag`; the tag is that of the question, None before STRIG/4."""

    t_us: int
    tag: int | None = None


@dataclass(frozen=True)
class Sample:
    """`S t_us` and twelve bytes: three accelerations, three rotation rates."""

    t_us: int
    digits: tuple[int, ...]


Event = Hello | Accepted | Refusal | Contact | BoxTime | Sample | UnrecognisedLine
ENDS = ("DONE", "ABORT", "WATCHDOG")
MOTIONS = ("SHAKE", "REST", "RELEASE")
EVENTS = ("SHUTTER", *ENDS, *MOTIONS)


def read_line(raw: bytes) -> Event:
    """Decode one line."""
    match raw.decode("ascii", "replace").split(" "):
        case ["STRIG/1" | "STRIG/2" | "STRIG/3" | "STRIG/4" as greeting, board, firmware, serial]:
            return Hello(board, firmware, serial, int(greeting[-1]))
        case ["OK", seq] if _whole(seq):
            return Accepted(int(seq))
        case ["SYNC", t_us] if _whole(t_us):
            return BoxTime(int(t_us))
        case ["SYNC", t_us, tag] if _whole(t_us) and _whole(tag):
            return BoxTime(int(t_us), int(tag))
        case ["S", t_us, data] if _whole(t_us) and SAMPLE.fullmatch(data):
            return Sample(int(t_us), struct.unpack(">6h", bytes.fromhex(data)))
        case ["EVT", "FLASH", t_us] if _whole(t_us):
            return Contact("FLASH", 0, int(t_us))
        case ["EVT", kind, seq, t_us] if kind in EVENTS and _whole(seq) and _whole(t_us):
            return Contact(kind, int(seq), int(t_us))
        case ["ERR", code, *text] if _whole(code):
            return Refusal(int(code), " ".join(text))
    return UnrecognisedLine(raw)


SAMPLE = re.compile("[0-9A-F]{24}")


def _whole(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) < 19


class StrigParser:
    """Bytes to events, one per line; from the greeting of a STRIG/4 box on every line must have its checksum."""

    def __init__(self) -> None:
        self._lines = LineSplitter()
        self._checked = False

    def feed(self, data: bytes) -> list[Event]:
        return [self._read(line) for line in self._lines.feed(data)]

    def _read(self, raw: bytes) -> Event:
        text, star, checksum = raw.rpartition(b"*")
        right = bool(star) and checksum == b"%02X" % reduce(xor, text, 0)
        if not right and (star or self._checked):
            return UnrecognisedLine(raw)
        event = read_line(text if right else raw)
        self._checked = self._checked or (right and isinstance(event, Hello))
        return event


def _verdict(event: Event) -> list[Accepted | Refusal] | None:
    return [event] if isinstance(event, Accepted | Refusal) else None


def _time_of(tag: int | None, event: Event) -> BoxTime | None:
    """The answer to the question for the time with this tag."""
    return event if isinstance(event, BoxTime) and event.tag == tag else None


class StrigShutter(LineDevice[Transport[Event]]):
    """A Shutter on a STRIG box; `version` is that of its protocol, 0 before `connect`."""

    def __init__(self, transport: Transport[Event], *, clock: Clock | None = None) -> None:
        super().__init__(transport, clock)
        self._contacts: dict[tuple[int, str], int] = {}
        self._flash_us: int | None = None
        self._offset_s = self._within_s = 0.0
        self._synchronised_s = 0.0
        self._tag = self.version = 0
        self.on_sample: Callable[[Sample], None] = lambda sample: None
        """Receives the samples of an inertial unit on this box."""
        self.motion: dict[str, Contact] = {}
        """The last event of each kind concerning a shaker or the motors on this box."""
        self._stopped: EmergencyStopped | None = None

    def connect(self) -> Identity:
        """Open, identify the box once it has booted, and synchronise the clocks. Raises DeviceError."""
        with opened(self._transport, self._hear):
            hello = self._ask_until(self.clock.now_s() + BOOT_S)
            self.version = hello.version
            self.synchronise()
        return Identity(f"STRIG/{hello.version} {hello.board}", hello.firmware, hello.serial, self.address)

    def _ask_until(self, deadline_s: float) -> Hello:
        while True:
            try:
                return self._transport.request(b"ID?\n", lambda e: e if isinstance(e, Hello) else None, REPLY_S)
            except NoAnswer:
                if self.clock.now_s() >= deadline_s:
                    raise
                self.clock.sleep(AGAIN_S)

    def synchronise(self, times: int = 3) -> None:
        """Clock offset from the fastest of a few round trips: its error is below half of that trip."""
        trips = []
        for _ in range(times):
            # the number of the next question for the time, so that a late answer to another one is none
            self._tag = (self._tag + 1) % 1000
            asked_s, tag = self.clock.now_s(), (self._tag if self.version >= 4 else None)
            question = b"SYNC?\n" if tag is None else b"SYNC? %d\n" % tag
            box = self._transport.request(question, partial(_time_of, tag), REPLY_S)
            received_s = self.clock.now_s()
            trips.append((received_s - asked_s, (asked_s + received_s) / 2 - box.t_us * 1e-6, received_s))
        trip_s, self._offset_s, self._synchronised_s = min(trips)
        self._within_s = trip_s / 2

    def _hear(self, event: Event, host_s: float) -> None:
        if isinstance(event, Sample):
            self.on_sample(event)
        elif isinstance(event, Contact) and event.kind in MOTIONS:
            self.motion[event.kind] = event
        elif isinstance(event, Contact):
            self._contacts[event.seq, event.kind] = event.t_us
            if event.kind == "FLASH":
                self._flash_us = event.t_us

    def focus(self, pressed: bool) -> None:
        self.command(f"FOCUS {int(pressed)}")

    @property
    def is_open(self) -> bool:
        return self._transport.is_open

    def within_s(self, t_us: int) -> float:
        """Bound of the error of `to_host_s`: half of the round trip, the drift since, and two rounded microseconds."""
        return self._within_s + DRIFT * abs(self.to_host_s(t_us) - self._synchronised_s) + 1e-6

    def to_host_s(self, t_us: int) -> float:
        """Convert a time of the box to the host's clock, by the last synchronisation."""
        return t_us * 1e-6 + self._offset_s

    def wait(self, ready: Callable[[], bool], timeout_s: float) -> bool:
        """Wait for a state that an event sets. Raises LineLost, or the interruption."""
        return self._transport.wait(ready, timeout_s)

    def command(self, line: str, allowed: Callable[[], None] = anything) -> int:
        """Give an order; returns its number. Raises DeviceError."""
        reply = self._transport.request(line.encode() + b"\n", _verdict, REPLY_S, allowed=allowed)[0]
        if isinstance(reply, Refusal):
            remedy = REFUSALS.get(reply.code, "check the cable")
            raise Rejected(f"{self.address} refused {line!r}: {reply.text}", remedy, f"ERR {reply.code}")
        return reply.seq

    def beat(self, next_ms: int) -> None:
        """Send a heartbeat that sets the next deadline; not in the transcript. Raises LineLost, NoAnswer."""
        self._transport.write(b"BEAT %d\n" % next_ms, noted=False)

    def fire(self, pulse_s: float, focus_s: float = 0.0) -> ShutterTimes:
        """Take one shot and report when the contact closed and opened. Raises DeviceError.

        After NoAnswer the shot may have been taken: it is never repeated automatically.
        """
        self._stopped = None
        self.synchronise()
        self._contacts.clear()
        self._flash_us = None
        seq = self.command(f"SHOT {round(focus_s * 1000)} {round(pulse_s * 1000)}", self._not_stopped)
        self._until_ended(seq, self.clock.now_s() + pulse_s + focus_s + 1.0)
        return self._times(seq, pulse_s)

    def _not_stopped(self) -> None:
        if self._stopped is not None:
            raise self._stopped

    def _until_ended(self, seq: int, deadline_s: float) -> None:
        def ended() -> bool:
            return any((seq, kind) in self._contacts for kind in ENDS)

        while not self._transport.wait(ended, min(KEEP_ALIVE_S, max(deadline_s - self.clock.now_s(), 0.0))):
            if self.clock.now_s() >= deadline_s:
                self._transport.write(b"ABORT\n")
                raise NoAnswer(f"{self.address} did not report the end of shot {seq}", "check whether it was taken")
            self.synchronise(1)

    def _times(self, seq: int, pulse_s: float) -> ShutterTimes:
        times = {kind: self.to_host_s(t_us) for (s, kind), t_us in self._contacts.items() if s == seq}
        if "DONE" not in times:
            raise MoveFailed(f"shot {seq} at {self.address} was cut short", "fire again")
        closed_s, released_s = times.get("SHUTTER"), times["DONE"]
        if closed_s is None or abs(released_s - closed_s - pulse_s) > TOLERANCE_S:
            held = "an unknown time" if closed_s is None else f"{1000 * (released_s - closed_s):.0f} ms"
            raise MoveFailed(f"the contact was closed for {held} instead of {1000 * pulse_s:.0f} ms", "check the cable")
        flash_s = None if self._flash_us is None else self.to_host_s(self._flash_us)
        if flash_s is not None and not closed_s <= flash_s <= released_s + FLASH_S:  # a damaged digit
            flash_s = None
        return ShutterTimes(closed_s, released_s, flash_s, self.within_s(self._contacts[seq, "DONE"]))

    def abort(self) -> None:
        self.command("ABORT")

    def close(self) -> None:
        """Open the contacts, let a shaker rest, and release the line."""
        with suppress(DeviceError):
            self._transport.write(ABORT)
        super().close()

    def emergency_stop(self) -> None:
        """Open the contacts without waiting for any lock."""
        self._stopped = error = EmergencyStopped(f"emergency stop at {self.address}", "fire again")
        self._transport.preempt(ABORT, error)


class BoxDevice(LineDevice[StrigShutter]):
    """A device on a box that a StrigShutter has connected: `what` it is, and the version of STRIG that has it."""

    what: ClassVar[str]
    since: ClassVar[int]

    def __init__(self, box: StrigShutter, clock: Clock | None = None) -> None:
        super().__init__(box, clock)
        self._box = box

    def connect(self) -> Identity:
        """Check that the box has the device. Raises BadConfiguration, LineLost."""
        self._require()
        if self._box.version < self.since:
            reason = f"the box at {self.address} speaks STRIG/{self._box.version}, which has no {self.what}"
            raise BadConfiguration(reason, "load the firmware of drivers/firmware")
        return Identity(f"STRIG/{self.since} {self.what}", "", "", self.address)

    def _require(self) -> None:
        if not self._box.is_open:
            raise LineLost(f"the shutter box at {self.address} is not connected", "connect the shutter first")

    def close(self) -> None:
        """No-op: the line belongs to the shutter."""


class NullParser:
    """A parser for lines without incoming data."""

    def feed(self, data: bytes) -> list[UnrecognisedLine]:
        return []


class OneContact(LineDevice[L]):
    """Common part of shutters without a focus contact."""

    def focus(self, pressed: bool) -> None:
        """Not supported. Raises Rejected."""
        raise Rejected(f"{self.address} has no focus contact", "focus by hand, or use a STRIG/1 box")


class RtsShutter(OneContact[Transport[UnrecognisedLine]]):
    """A Shutter wired to the RTS line of a bare adapter: no firmware, no focus contact, no confirmation.

    Its transport must be opened with `rts=False`; otherwise opening the port takes a photograph.
    """

    def __init__(self, transport: Transport[UnrecognisedLine], *, clock: Clock | None = None) -> None:
        super().__init__(transport, clock)
        self._aborted = False

    def connect(self) -> Identity:
        """Open the port with the contact open. Raises LineLost."""
        with opened(self._transport):
            self._transport.set_lines(rts=False)
        return Identity("RTS line", "", "", self.address)

    def fire(self, pulse_s: float, focus_s: float = 0.0) -> ShutterTimes:
        """Close for `pulse_s`; the times are the host's. Raises LineLost, MoveFailed."""
        self._aborted = False
        self._transport.wait(lambda: self._aborted, focus_s)
        closed_s = self.clock.now_s()
        try:
            self._transport.set_lines(rts=not self._aborted)
            self._transport.wait(lambda: self._aborted, pulse_s)
        finally:
            self._transport.set_lines(rts=False)
        if self._aborted:
            raise MoveFailed(f"the shot at {self.address} was cut short", "fire again")
        return ShutterTimes(closed_s, self.clock.now_s())

    def abort(self) -> None:
        self._aborted = True
        self._transport.set_lines(rts=False)

    def emergency_stop(self) -> None:
        """Open the contact without waiting for any lock."""
        self._aborted = True
        with suppress(LineLost):
            self._transport.set_lines(rts=False)
        self._transport.preempt(b"", EmergencyStopped(f"emergency stop at {self.address}", "fire again"))


class RelayShutter(GrblOutput, OneContact[GrblLink]):
    """A Shutter on the coolant relay of a GRBL controller (M8, M9), which switches after preceding motion."""

    name = "GRBL relay"

    def fire(self, pulse_s: float, focus_s: float = 0.0) -> ShutterTimes:
        """Close for `pulse_s`; the times are those of the controller's responses. Raises DeviceError."""
        undisturbed = partial(self.link.trust.undisturbed, self.link.trust.epoch)
        self.link.pause(focus_s)
        with left_still(self.abort, self.emergency_stop, self.link.trust):
            self.link.command("M8", 2.0, undisturbed)
            closed_s = self.clock.now_s()
            self.link.command(f"G4 P{pulse_s:.3f}", pulse_s + 1.0)
        self.abort()
        return ShutterTimes(closed_s, self.clock.now_s())

    def abort(self) -> None:
        self.link.command("M9", 2.0)

    def emergency_stop(self) -> None:
        """Reset the controller, which opens its relay."""
        self.link.preempt(b"\x18", EmergencyStopped(f"emergency stop at {self.address}", "connect again"))


@dataclass(frozen=True, kw_only=True)
class StrigOptions(LineOptions):
    """Options of driver "strig"."""

    makes = StrigShutter
    parser = StrigParser
    provides: ClassVar[tuple[str, ...]] = (SHUTTER, STRIG_BOX)


@dataclass(frozen=True, kw_only=True)
class RtsOptions(DriverOptions):
    """Options of driver "rts"."""

    provides: ClassVar[tuple[str, ...]] = (SHUTTER,)
    port: Port

    def make(self, parts: MakerContext) -> RtsShutter:
        return RtsShutter(parts.wire(self.port, NullParser, rts=False), clock=parts.clock)


@dataclass(frozen=True, kw_only=True)
class RelayOptions(OutputOptions):
    """Options of driver "relay"."""

    provides: ClassVar[tuple[str, ...]] = (SHUTTER,)

    def make(self, parts: MakerContext) -> RelayShutter:
        link, own = self.link(parts)
        return RelayShutter(link, clock=parts.clock, owns_link=own)
