"""Communication with a GRBL controller: one response per line; reports, settings, greetings, and trust.

Trust is whether the position is reliable: homing establishes it; reset, alarm and emergency stop revoke it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, TypeVar

from drivers.errors import Alarm, Clock, DeviceError, LineLost, NoAnswer, NotHomed, Rejected, WasReset
from drivers.interfaces import Identity, Transport
from drivers.move_checks import HOME, UNHOMED, Trust
from drivers.protocols.grbl import (
    PAUSES,
    RESET,
    RESUMABLE,
    STATUS,
    AlarmRaised,
    Banner,
    ConfigItem,
    Controls,
    Event,
    Failed,
    Feedback,
    GrblSetting,
    Ok,
    Status,
    alarm_text,
    error_text,
)
from drivers.wire.connection import URGENT_S, LineDevice, anything, not_connected, opened

T = TypeVar("T")
REPLY_S = 1.0
STATUS_S = 0.5
STILL = ("Idle", "Alarm", "Sleep", "Check")
GREETING_S = 2.5  # an Arduino's boot loader waits up to two seconds
RESETS = 4  # resets sent in that time: GRBL ignores input for half a second after `ALARM:1` and `ALARM:2`


@dataclass(frozen=True)
class StatusReport:
    """State, sub-state, and machine position in millimetres or degrees, one value per letter."""

    state: str
    sub: int
    machine: tuple[float, ...]

    @property
    def pause(self) -> tuple[str, str] | None:
        """Why a person paused it, and the remedy; None if nobody did."""
        return PAUSES.get((self.state, self.sub))

    @property
    def still(self) -> bool:
        """Whether nothing moves, and nothing will without a new command."""
        return self.state in STILL or (self.state, self.sub) in (*RESUMABLE, ("Door", 1))


class GrblLink:
    """Commands, reports and trust over one transport."""

    def __init__(self, transport: Transport[Event]) -> None:
        self._transport = transport
        self.letters = "XYZABC"
        self.rx_bytes = 128
        self.last_state, self.last_sub = "unknown", 0
        self.feed_override = 100.0
        self.last_message = ""
        """The last message, since a move began."""
        self.trust = Trust()
        self._ready = False
        self._settings: dict[int, float] = {}
        self._spaces: dict[int, tuple[float, float]] = {}
        self._options = ""
        self.resets = 0
        self._resets_due = 0
        self._repeats_errors = False
        self._offset: tuple[float, ...] | None = None
        self._in_step = True
        self._banner: Banner | None = None
        self._locked: int | None = None

    @property
    def address(self) -> str:
        return self._transport.address

    @property
    def is_open(self) -> bool:
        """Whether it has greeted and the line is still open."""
        return self._ready and self._transport.is_open

    @property
    def controls(self) -> Controls:
        """The controller's settings."""
        return Controls(self._settings, self._options, self._spaces)

    def setting(self, number: int, default: float | None) -> float | None:
        """The controller's `$number`, or `default` if it is not reported."""
        return self._settings.get(number, default)

    def connect(self, *, reset: bool) -> Identity:
        """Open, await the greeting, and read identity and settings. Raises DeviceError."""
        self.close()
        self._banner, self._locked, self._offset, self._in_step = None, None, None, True
        self._resets_due = self.resets
        self.feed_override = 100.0
        with opened(self._transport, self._hear):
            self._greet(reset)
            try:
                identity = self._identify()
            except WasReset:  # a boot loader and our own reset may each cause a greeting
                identity = self._identify()
            self._settings, self._spaces = self._twice_alike(self._read_settings), {}
            if identity.model == "FluidNC":
                # FluidNC's own settings; its numbered ones are a subset for compatibility
                letters = self.letters[: len(self.report().machine)]
                values = self._twice_alike(lambda: {item: self._item(item) for item in items(letters)})
                self._settings |= read_settings(letters, values.get)
                self._spaces = {}
                for at, letter in enumerate(letters):
                    axis = f"axes/{letter.lower()}"
                    end, length = (number(values.get(f"{axis}/{name}")) for name in ("homing/mpos_mm", "max_travel_mm"))
                    if end is not None and length is not None:
                        up = values.get(f"{axis}/homing/positive_direction") != "false"
                        self._spaces[at] = (end - length, end) if up else (end, end + length)
        self._ready, self.trust.why = True, UNHOMED
        return identity

    def close(self) -> None:
        """Release the line; the position is not trusted afterwards."""
        self._ready = False
        self.trust.lose(UNHOMED)
        self._transport.close()

    def _greet(self, reset: bool) -> None:
        """Await the greeting: opening the port resets most boards; otherwise request a reset."""
        if not reset:
            self._resynchronise()
            return
        if self._transport.wait(lambda: self._banner is not None, GREETING_S):
            return
        if not self._reset():
            raise NoAnswer(f"no GRBL controller answers at {self.address}", "check power, port and baud rate (115200)")

    def _reset(self) -> bool:
        self._banner = None
        for _ in range(RESETS):
            self._transport.write(RESET)
            if self._transport.wait(lambda: self._banner is not None, GREETING_S / RESETS):
                return True
        return False

    def _identify(self) -> Identity:
        try:
            events = self.command("$I+")
        except Rejected:  # plain GRBL does not know `$I+`
            events = self.command("$I")
        parts = {event.tag: event.text for event in events if isinstance(event, Feedback)}
        version, _, name = parts.get("VER", "").partition(":")
        options = parts.get("OPT", "").split(",")
        self._options = options[0]
        if len(options) > 2 and options[2].isdigit():
            self.rx_bytes = int(options[2])
        firmware = parts.get("FIRMWARE") or (self._banner.firmware if self._banner else "GRBL")
        self._repeats_errors = firmware == "grblHAL"
        return Identity(model=firmware, firmware=version, serial=name, address=self.address)

    def _read_settings(self) -> dict[int, float]:
        return {event.number: event.value for event in self.command("$$") if isinstance(event, GrblSetting)}

    def _twice_alike(self, read: Callable[[], T]) -> T:
        """A value read twice with the same result: without checksums, a damaged digit reads as another travel."""
        before = read()
        for _ in range(3):
            now = read()
            if now == before:
                return now
            before = now
        raise NoAnswer(f"{self.address} reports different settings each time", "check the cable")

    def _item(self, path: str) -> str | None:
        try:
            events = self.command(f"$/{path}")
        except Rejected:  # not in this version, or not configured
            return None
        return next((event.value for event in events if isinstance(event, ConfigItem) and event.path == path), None)

    def command(self, line: str, timeout_s: float = REPLY_S, allowed: Callable[[], None] = anything) -> list[Event]:
        """Send one line; returns the events up to its response. Raises Rejected, Alarm, WasReset, NoAnswer.

        `allowed` is called when nothing can intervene any more, and raises why the line may not be sent.
        """
        if not self._in_step:
            self._resynchronise()
        events: list[Event] = []

        def answer(event: Event) -> Event | None:
            events.append(event)
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
        return events

    def _resynchronise(self) -> None:
        """Resynchronise after a missing reply: only `$G` answers `[GC:`, and the next response belongs to it.

        `)$` ends a comment and makes an order refused whose end was lost: a bare end of line would carry it out now.
        `$G` also ends grblHAL's refusal of every line after a wrong one.
        """
        marker: list[Event] = []

        def answer(event: Event) -> bool | None:
            if isinstance(event, Feedback) and event.tag == "GC":
                marker.append(event)
            return True if marker and isinstance(event, Ok) else None

        self._transport.request(b")$\n$G\n", answer, REPLY_S)
        self._in_step = True

    def report(self) -> StatusReport:
        """Request `?`, repeatedly if unanswered; position in machine space. Raises DeviceError."""
        return self._transport.request(STATUS, self._placed, STATUS_S, tries=3)

    def settled_report(self) -> StatusReport:
        """Two reports in a row that agree: GRBL sends no checksums, and a damaged digit reads as another position.

        While it moves, the later one. Raises DeviceError.
        """
        before = self.report()
        for _ in range(5):
            now = self.report()
            if now.machine == before.machine or now.state not in STILL:
                return now
            before = now
        raise NoAnswer(
            f"{self.address} reports a different position each time", "check the cable, and that nothing moves it"
        )

    def _placed(self, event: Event) -> StatusReport | None:
        """A report's machine position: MPos, or WPos + WCO once an offset is known; inches if $13 says so."""
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
        """Wait; ended early by `over`, alarm, reset or emergency stop. Raises the latter three.

        `over` is called after every event.
        """
        epoch = self.trust.epoch
        self._transport.wait(lambda: self.trust.epoch != epoch or over(), duration_s)
        if self.trust.epoch != epoch:
            self.trust.require()

    def write(self, realtime: bytes) -> None:
        """Send realtime bytes without queueing. Raises LineLost, NoAnswer if the port accepts none."""
        self._transport.write(realtime, within_s=URGENT_S)

    def preempt(self, realtime: bytes, error: DeviceError) -> None:
        """Send realtime bytes without waiting for any lock and end every wait; the position is lost."""
        self.trust.preempt(error)
        self._resets_due = self.resets + 1
        self._transport.preempt(realtime, error)

    def halt(self, error: DeviceError) -> None:
        """Reset the controller without waiting for any lock, and end every wait with `error`; the position is lost."""
        self.trust.lose(error)
        self._resets_due = self.resets + 1
        self._transport.preempt(RESET, error)

    def confirm_reset(self) -> None:
        """Repeat an ordered reset until the controller greets: a silent line may have lost it. Raises DeviceError."""
        if self._transport.wait(lambda: self.resets >= self._resets_due, GREETING_S / RESETS):
            return
        if not self._reset():
            raise NoAnswer(f"{self.address} does not stop", "press the emergency stop at the bench")

    def recover(self) -> int:
        """Bring a locked or silent controller to a state in which it can home; the epoch. Raises DeviceError."""
        if not self.is_open:
            raise not_connected(self.address)
        preemptions = self.trust.preemptions
        locked, self._locked = self._locked, None
        if (locked in (1, 2, 10) or self._unanswering()) and not self._reset():
            raise NoAnswer(f"{self.address} does not come back from a reset", "switch the controller off and on")
        return self.trust.begin(preemptions)

    def _unanswering(self) -> bool:
        try:
            return self.report().state in ("Sleep", "Hold", "Door", "Check")
        except NoAnswer:
            return True

    def require_trust(self) -> None:
        """Raises why the stage may not move."""
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
            if event.state == "Alarm" and self.trust.why is None:  # neither a greeting nor an alarm was received
                self.trust.lose(NotHomed(f"{self.address} is locked", HOME))
        elif isinstance(event, Feedback):
            self.last_message = event.text if event.tag == "MSG" else self.last_message
        elif isinstance(event, AlarmRaised):
            self._locked = event.code
            self.trust.lose(self._alarm(event.code))
        elif isinstance(event, Banner):
            self._banner = event
            self.resets += 1
            self.trust.lose(self._restarted())


class GrblOutput(LineDevice[GrblLink]):
    """A lamp or a relay on an output, `name`, of a controller: a stage may own its link."""

    name: ClassVar[str]

    def __init__(self, link: GrblLink, *, clock: Clock | None = None, owns_link: bool = True) -> None:
        super().__init__(link, clock)
        self.link, self._owns_link = link, owns_link

    def connect(self) -> Identity:
        """Open the line, unless it belongs to a stage. Raises DeviceError."""
        if self._owns_link:
            identity = self.link.connect(reset=True)
            self.link.command("$X")  # there is nothing to home
            return identity
        if not self.link.is_open:
            raise LineLost(f"the stage at {self.address} is not connected", "connect the stage first")
        return Identity(self.name, "", "", self.address)

    def close(self) -> None:
        """Release the line, unless it belongs to a stage."""
        if self._owns_link:
            self.link.close()


# --- Configuration of FluidNC that has no numbered settings, read item by item ---
# `$/axes/x/max_travel_mm` is answered by `$/axes/x/max_travel_mm=300.000`; an item that does not exist by an error.
# Source: FluidNC, Machine/Axis.cpp, Homing.cpp, Motor.cpp, Configuration/RuntimeSetting.cpp.

Ask = Callable[[str], str | None]  # the value of one item, None if the controller does not have it

MACHINE = {1: "stepping/idle_ms", 13: "report_inches"}
AXIS = {100: "steps_per_mm", 110: "max_rate_mm_per_min", 120: "acceleration_mm_per_sec2", 130: "max_travel_mm"}
SHARED = {24: "homing/feed_mm_per_min", 25: "homing/seek_mm_per_min", 27: "motor0/pulloff_mm"}
"""GRBL has one number for what FluidNC has for each axis; the more cautious value is used."""
SWITCHES = {20: "soft_limits", 21: "motor0/hard_limits"}


def items(letters: str) -> list[str]:
    """All items to be read, for the axes of these letters."""
    names = [*AXIS.values(), *SHARED.values(), *SWITCHES.values(), "homing/mpos_mm", "homing/positive_direction"]
    return [*MACHINE.values(), *(f"axes/{letter.lower()}/{item}" for letter in letters for item in names)]


def number(text: str | None) -> float | None:
    """A number, or 1 and 0 for true and false; None for anything else."""
    if text in ("true", "false"):
        return float(text == "true")
    try:
        return None if text is None else float(text)
    except ValueError:
        return None


def read_settings(letters: str, ask: Ask) -> dict[int, float]:
    """GRBL's numbered settings derived from the configuration, for the axes of these letters."""
    settings = {n: value for n, item in MACHINE.items() if (value := number(ask(item))) is not None}
    for at, letter in enumerate(letters):
        for first, item in AXIS.items():
            if (value := number(ask(f"axes/{letter.lower()}/{item}"))) is not None:
                settings[first + at] = value
    for n, item in (SHARED | SWITCHES).items():
        values = [v for letter in letters if (v := number(ask(f"axes/{letter.lower()}/{item}"))) is not None]
        if values:
            settings[n] = max(values) if n in (21, 27) else min(values)
    return settings
