"""The conversation with a GRBL controller: one line, one response; reports, settings, greetings, and trust.

Trust is whether the position may be believed: homing gives it; reset, alarm, emergency stop take it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from drivers.errors import Alarm, DeviceError, LineLost, NoAnswer, NotHomed, Rejected, WasReset
from drivers.fluidnc import items, read_settings, read_spaces
from drivers.grbl_envelope import Controls
from drivers.homing_state import HOME, UNHOMED, Trust
from drivers.interfaces import Identity, Transport
from drivers.protocols.grbl import (
    PAUSES,
    RESET,
    RESUMABLE,
    STATUS,
    AlarmRaised,
    Banner,
    ConfigItem,
    Event,
    Failed,
    Feedback,
    GrblSetting,
    Ok,
    Status,
    alarm_text,
    error_text,
)
from drivers.wire.connection import anything, not_connected, opened
from drivers.wire.outgoing import URGENT_S

T = TypeVar("T")
REPLY_S = 1.0
STATUS_S = 0.5
STILL = ("Idle", "Alarm", "Sleep", "Check")
GREETING_S = 2.5  # an Arduino's boot loader waits up to two seconds
RESETS = 4
"""Resets asked for in that time: GRBL hears none for half a second after `ALARM:1` and `ALARM:2`."""


@dataclass(frozen=True)
class StatusReport:
    """State, sub-state, and machine position in millimetres or degrees, one value per letter."""

    state: str
    sub: int
    machine: tuple[float, ...]

    @property
    def pause(self) -> tuple[str, str] | None:
        """Why a person holds it, and what to do; None where nobody does."""
        return PAUSES.get((self.state, self.sub))

    @property
    def still(self) -> bool:
        """Whether nothing moves, and nothing will before it is told to."""
        return self.state in STILL or (self.state, self.sub) in (*RESUMABLE, ("Door", 1))


class GrblLink:
    """Commands, reports and trust over one transport."""

    def __init__(self, transport: Transport[Event]) -> None:
        self._transport = transport
        self.letters = "XYZABC"
        self.rx_bytes = 128
        self.last_state, self.last_sub = "unknown", 0
        self.feed_override = 100.0
        self.said = ""
        """The last message, since a move began."""
        self.trust = Trust()
        self._ready = False
        self._settings: dict[int, float] = {}
        self._spaces: dict[int, tuple[float, float]] = {}
        self._options = ""
        self.resets = 0
        self._repeats_errors = False
        self._offset: tuple[float, ...] | None = None
        self._in_step = True
        self._banner: Banner | None = None
        self._locked: int | None = None

    @property
    def address(self) -> str:
        """The port or URL."""
        return self._transport.address

    @property
    def is_open(self) -> bool:
        """Whether it was greeted and the line is still there."""
        return self._ready and self._transport.is_open

    @property
    def controls(self) -> Controls:
        """What the controller is set to."""
        return Controls(self._settings, self._options, self._spaces)

    def setting(self, number: int, default: float | None) -> float | None:
        """The controller's `$number`, or `default` where it tells none."""
        return self._settings.get(number, default)

    def connect(self, *, reset: bool) -> Identity:
        """Open, greet, and read who and how it is. Raises DeviceError."""
        self.close()
        self._banner, self._locked, self._offset, self._in_step = None, None, None, True
        self.feed_override = 100.0
        with opened(self._transport, self._hear):
            self._greet(reset)
            try:
                identity = self._identify()
            except WasReset:  # a boot loader and our own reset may both greet
                identity = self._identify()
            self._settings, self._spaces = self._twice_alike(self._read_settings), {}
            if identity.model == "FluidNC":
                self._read_configuration()
        self._ready, self.trust.why = True, UNHOMED
        return identity

    def connect_output(self, name: str, alone: bool) -> Identity:
        """For a lamp or a relay: open the line, unless a stage does that. Raises DeviceError."""
        if alone:
            identity = self.connect(reset=True)
            self.command("$X")  # there is nothing to home
            return identity
        if not self.is_open:
            raise LineLost(f"the stage at {self.address} is not connected", "connect the stage first")
        return Identity(name, "", "", self.address)

    def close(self) -> None:
        """Give the line back; the position cannot be trusted afterwards."""
        self._ready = False
        self.trust.lose(UNHOMED)
        self._transport.close()

    def _greet(self, reset: bool) -> None:
        """Opening the port resets most boards, so a greeting comes; where none does, ask for one."""
        if not reset:
            self._resynchronise()
            return
        if self._transport.wait(lambda: self._banner is not None, GREETING_S):
            return
        if not self._reset():
            raise NoAnswer(f"no GRBL controller greets at {self.address}", "check power, port and baud rate (115200)")

    def _reset(self) -> bool:
        self._banner = None
        for _ in range(RESETS):
            self._transport.write(RESET)
            if self._transport.wait(lambda: self._banner is not None, GREETING_S / RESETS):
                return True
        return False

    def _identify(self) -> Identity:
        try:
            said = self.command("$I+")
        except Rejected:  # plain GRBL knows no `$I+`
            said = self.command("$I")
        told = {event.tag: event.text for event in said if isinstance(event, Feedback)}
        version, _, name = told.get("VER", "").partition(":")
        options = told.get("OPT", "").split(",")
        self._options = options[0]
        if len(options) > 2 and options[2].isdigit():
            self.rx_bytes = int(options[2])
        firmware = told.get("FIRMWARE") or (self._banner.firmware if self._banner else "GRBL")
        self._repeats_errors = firmware == "grblHAL"
        return Identity(model=firmware, firmware=version, serial=name, address=self.address)

    def _read_settings(self) -> dict[int, float]:
        return {event.number: event.value for event in self.command("$$") if isinstance(event, GrblSetting)}

    def _twice_alike(self, read: Callable[[], T]) -> T:
        """What the controller tells twice alike: without checksums, a damaged digit looks like another travel."""
        before = read()
        for _ in range(3):
            now = read()
            if now == before:
                return now
            before = now
        raise NoAnswer(f"{self.address} tells other settings each time", "check the cable")

    def _read_configuration(self) -> None:
        """FluidNC's own settings; its numbered ones are some of them, for programs that ask for nothing else."""
        letters = self.letters[: len(self.report().machine)]
        told = self._twice_alike(lambda: {item: self._item(item) for item in items(letters)})
        self._settings |= read_settings(letters, told.get)
        self._spaces = read_spaces(letters, told.get)

    def _item(self, path: str) -> str | None:
        try:
            said = self.command(f"$/{path}")
        except Rejected:  # not in this version, or not configured
            return None
        return next((event.value for event in said if isinstance(event, ConfigItem) and event.path == path), None)

    def command(self, line: str, timeout_s: float = REPLY_S, allowed: Callable[[], None] = anything) -> list[Event]:
        """Send one line; the events up to its response. Raises Rejected, Alarm, WasReset, NoAnswer.

        `allowed` is asked when nothing can come between any more, and raises why the line may not be sent.
        """
        if not self._in_step:
            self._resynchronise()
        said: list[Event] = []

        def answer(event: Event) -> Event | None:
            said.append(event)
            return event if isinstance(event, Ok | Failed | AlarmRaised | Banner) else None

        try:
            reply = self._transport.request(line.encode() + b"\n", answer, timeout_s, allowed=allowed)
        except NoAnswer:
            self._in_step = False
            raise
        if isinstance(reply, Failed):
            self._in_step = not self._repeats_errors
            reason, remedy = error_text(reply.code)
            raise Rejected(f"{self.address} refused {line!r}: {reason}", remedy, f"error:{reply.code}")
        if isinstance(reply, AlarmRaised):
            raise self._alarm(reply.code)
        if isinstance(reply, Banner):
            raise self._restarted()
        return said

    def _resynchronise(self) -> None:
        """After a reply that never came: `$G` alone answers `[GC:`, and the response after that is its own.

        It also ends grblHAL's way of refusing every line after one that was wrong.
        """
        seen: list[Event] = []

        def answer(event: Event) -> bool | None:
            if isinstance(event, Feedback) and event.tag == "GC":
                seen.append(event)
            return True if seen and isinstance(event, Ok) else None

        self._transport.request(b"\n$G\n", answer, REPLY_S)
        self._in_step = True

    def report(self) -> StatusReport:
        """Ask `?`, again if it goes unanswered; position in machine space. Raises DeviceError."""
        return self._transport.request(STATUS, self._placed, STATUS_S, tries=3)

    def settled_report(self) -> StatusReport:
        """Two reports in a row that agree: GRBL sends no checksums, and a damaged digit looks like another place.

        While it moves, the later one. Raises DeviceError.
        """
        before = self.report()
        for _ in range(5):
            now = self.report()
            if now.machine == before.machine or now.state not in STILL:
                return now
            before = now
        raise NoAnswer(
            f"{self.address} reports another position each time", "check the cable, and that nothing moves it"
        )

    def _placed(self, event: Event) -> StatusReport | None:
        """A report's machine position: MPos, or WPos + WCO once an offset was told; inches where $13 says so."""
        if not isinstance(event, Status):
            return None
        machine, work = event.numbers("MPos"), event.numbers("WPos")
        if machine is None and work is not None and self._offset is not None:
            machine = tuple(a + b for a, b in zip(work, self._offset, strict=False))
        if machine is None:
            return None
        scale = 25.4 if self.setting(13, 0.0) == 1.0 else 1.0
        return StatusReport(event.state, event.sub, tuple(value * scale for value in machine))

    def pause(self, duration_s: float, over: Callable[[], bool] = lambda: False) -> None:
        """Wait, ended early by alarm, reset or emergency stop, and where it is over. Raises what ended it.

        `over` is asked after every event on the wire.
        """
        epoch = self.trust.epoch
        self._transport.wait(lambda: self.trust.epoch != epoch or over(), duration_s)
        if self.trust.epoch != epoch:
            self.trust.require()

    def write(self, realtime: bytes) -> None:
        """Send realtime bytes, past the queue of requests. Raises LineLost, NoAnswer where the port takes none."""
        self._transport.write(realtime, within_s=URGENT_S)

    def shout(self, realtime: bytes, error: DeviceError) -> None:
        """Send realtime bytes past every lock and end every wait; the position is lost."""
        self.trust.shout(error)
        self._transport.shout(realtime, error)

    def halt(self, error: DeviceError) -> None:
        """Reset the controller past every lock, and end every wait with `error`; the position is lost."""
        self.trust.lose(error)
        self._transport.shout(RESET, error)

    def recover(self) -> int:
        """Bring a locked or silent controller to where it can home; the epoch for `trust`. Raises DeviceError."""
        if not self.is_open:
            raise not_connected(self.address)
        shouts = self.trust.shouts
        locked, self._locked = self._locked, None
        if (locked in (1, 2, 10) or self._unanswering()) and not self._reset():
            raise NoAnswer(f"{self.address} does not come back from a reset", "switch the controller off and on")
        return self.trust.begin(shouts)

    def _unanswering(self) -> bool:
        try:
            return self.report().state in ("Sleep", "Hold", "Door", "Check")
        except NoAnswer:
            return True

    def require_trust(self) -> None:
        """Raises why the stage may not move now."""
        if not self.is_open:
            raise not_connected(self.address)
        self.trust.require()

    def _restarted(self) -> WasReset:
        return WasReset(f"{self.address} restarted", HOME)

    def _alarm(self, code: int) -> Alarm:
        reason, remedy = alarm_text(code)
        return Alarm(f"{self.address}: {reason}", remedy, f"ALARM:{code}")

    def _hear(self, event: Event, host_s: float) -> None:
        if isinstance(event, Status):
            self.last_state, self.last_sub = event.state, event.sub
            self.feed_override = event.override or self.feed_override
            self._offset = event.numbers("WCO") or self._offset
            if event.state == "Alarm" and self.trust.why is None:  # nobody heard it greet, or say why
                self.trust.lose(NotHomed(f"{self.address} is locked", HOME))
        elif isinstance(event, Feedback):
            self.said = event.text if event.tag == "MSG" else self.said
        elif isinstance(event, AlarmRaised):
            self._locked = event.code
            self.trust.lose(self._alarm(event.code))
        elif isinstance(event, Banner):
            self._banner = event
            self.resets += 1
            self.trust.lose(self._restarted())
