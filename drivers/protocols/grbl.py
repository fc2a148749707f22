"""Messages of GRBL 1.1, grblHAL and FluidNC: bytes to events, and their codes with reason and remedy.

Every command line is answered by exactly one `Ok` or `Failed`; all other messages are unsolicited.
Sources: gnea/grbl doc/markdown/interface.md, jogging.md, doc/csv; grblHAL/core errors.h, alarms.h.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Literal, TypeVar

from drivers.interfaces import Travel
from drivers.options import AxisName, Interval, option, positive
from drivers.protocols.framing import Decoder, LineSplitter, UnrecognisedLine, numbered

Default = TypeVar("Default", bound=float | None)

STATUS, HOLD, RESUME, RESET, JOG_CANCEL = b"?", b"!", b"~", b"\x18", b"\x85"

ERRORS = numbered("grbl error")
ALARMS = numbered("grbl alarm")
PAUSES: dict[tuple[str, int], tuple[str, str]] = {
    ("Door", 0): ("is paused at the door, which is closed again", "resume at the controller, or try again"),
    ("Door", 1): ("is paused at the door", "close it and resume"),
    ("Door", 2): ("decelerates: the door was opened", "close it and resume"),
    ("Door", 3): ("restarts after the door was closed", "wait"),
    ("Hold", 0): ("is paused: feed hold was pressed", "resume at the controller, or try again"),
    ("Hold", 1): ("decelerates: feed hold was pressed", "resume at the controller, or try again"),
}
"""Pauses by a person at the machine, by state and sub-state."""
RESUMABLE = (("Door", 0), ("Hold", 0))
DOOR_MESSAGE = "Check Door"  # the message of an opened door; grblHAL's reports show a jog paused by it as still running
MOTORS_HELD = 255.0  # `$1`: milliseconds after which motors at rest are released; this value keeps them on


def error_text(code: int) -> tuple[str, str]:
    """Reason and remedy of `error:code`."""
    return ERRORS.get(code, (f"error {code}, which is not documented", "read the controller's manual"))


def alarm_text(code: int) -> tuple[str, str]:
    """Reason and remedy of `ALARM:code`."""
    return ALARMS.get(code, (f"alarm {code}, which is not documented", "reset the controller, then home"))


@dataclass(frozen=True)
class Ok:
    """The line was accepted: planned, not executed."""


@dataclass(frozen=True)
class Failed:
    """`error:N`: the line was refused."""

    code: int


@dataclass(frozen=True)
class AlarmRaised:
    """`ALARM:N`: the controller stopped and locked itself."""

    code: int


@dataclass(frozen=True)
class Status:
    """`<...>`: state, sub-state, and the fields of this report, by name."""

    state: str
    sub: int
    fields: dict[str, str]

    @property
    def override(self) -> float | None:
        """The feed override in percent, if this report carries it."""
        values = self.numbers("Ov")
        return values[0] if values else None

    def numbers(self, name: str) -> tuple[float, ...] | None:
        """A field's numbers; None if the report has no such field or it cannot be read."""
        try:
            return tuple(float(part) for part in self.fields[name].split(","))
        except (KeyError, ValueError):
            return None


@dataclass(frozen=True)
class GrblSetting:
    """`$number=value` in the answer to `$$`."""

    number: int
    value: float


@dataclass(frozen=True)
class ConfigItem:
    """`$/path=value`: one item of FluidNC's configuration."""

    path: str
    value: str


@dataclass(frozen=True)
class Feedback:
    """`[TAG:text]`."""

    tag: str
    text: str


@dataclass(frozen=True)
class Banner:
    """The greeting after power-up or reset: position and modes have their initial values."""

    firmware: str
    version: str


Event = Ok | Failed | AlarmRaised | Status | GrblSetting | ConfigItem | Feedback | Banner | UnrecognisedLine

STATES = {"Idle", "Run", "Hold", "Jog", "Alarm", "Door", "Check", "Home", "Sleep", "Tool"}
_NUMBERED = re.compile(r"(error|ALARM):(\d{1,4})")
_SETTING = re.compile(r"\$(\d{1,4})=(-?\d{1,10}(?:\.\d{0,10})?)(?: .*)?")
_CONFIG = re.compile(r"\$/([A-Za-z0-9_/]+)=(.*)")
_FEEDBACK = re.compile(r"\[([A-Z0-9+]{2,12}):(.*)\]")
_FLUIDNC = re.compile(r"Grbl \S+ \[FluidNC v?(\S+) .*")
_BANNER = re.compile(r"(Grbl|GrblHAL) (\d+\.\S+) \[.*")
_NUMBER = r"-?\d{1,10}(?:\.\d{0,10})?"
_NUMERIC = re.compile(rf"(?:[MW]Pos|WCO|FS?|Ov|Bf|Ln):{_NUMBER}(?:,{_NUMBER})*")
_OTHER = re.compile(r"(?!(?:[MW]Pos|WCO|FS?|Ov|Bf|Ln):)[A-Za-z]{1,8}:[^|<>]*")
"""A field that is read holds numbers; others may hold anything, such as the path in FluidNC's `SD:12.00,/job.nc`."""


def read_status(text: str) -> Status | None:
    """The report between `<` and `>`, with its fields in any order; None if it is damaged."""
    head, *fields = text.split("|")
    state, _, sub = head.partition(":")
    if (
        state not in STATES
        or (sub and not sub.isdigit())
        or not all(_NUMERIC.fullmatch(part) or _OTHER.fullmatch(part) for part in fields)
    ):
        return None
    pairs = (part.partition(":") for part in fields)
    return Status(state, int(sub or 0), {name: value for name, _, value in pairs})


def read_line(raw: bytes) -> Event:
    """Decode one line."""
    try:
        line = raw.decode("ascii").strip()
    except UnicodeDecodeError:
        return UnrecognisedLine(raw)
    if line == "ok":
        return Ok()
    if line.startswith("<") and line.endswith(">"):
        return read_status(line[1:-1]) or UnrecognisedLine(raw)
    if match := _NUMBERED.fullmatch(line):
        return Failed(int(match[2])) if match[1] == "error" else AlarmRaised(int(match[2]))
    if match := _SETTING.fullmatch(line):
        return GrblSetting(int(match[1]), float(match[2]))
    if match := _CONFIG.fullmatch(line):
        return ConfigItem(match[1], match[2])
    if match := _FEEDBACK.fullmatch(line):
        return Feedback(match[1], match[2])
    if match := _FLUIDNC.fullmatch(line):
        return Banner("FluidNC", match[1])
    if match := _BANNER.fullmatch(line):
        return Banner("grblHAL" if match[1] == "GrblHAL" else "GRBL", match[2])
    return UnrecognisedLine(raw)


GrblParser = partial(Decoder[Event], LineSplitter, read_line)


# --- Limits of an axis according to the settings of a GRBL-like controller: travel, speed, acceleration ---
# Machine space is `[-L, 0]` on plain GRBL. Where homing sets the origin (`Z` among the options of `$I`, bit 3 of
# grblHAL's `$22`) it begins at the switch: `[0, L]` for an axis that homes downwards. FluidNC reports its ends.

FORCE_ORIGIN = 8  # bit of grblHAL's `$22`: homing sets the origin
HOME_FIRST = 4  # bit of grblHAL's `$22`: locked after power-up until homed, as GRBL always is
SEARCH_AND_BACK, SEARCH_AGAIN = 2.5, 12.0
"""Search distances of homing: in travels when fast, in pull-offs when slow (grblHAL uses ten, GRBL five)."""


@dataclass(frozen=True)
class GrblAxis:
    """One axis: its name with the unit, the controller's letter, its feed, and the place of its zero in machine space.

    `origin` None puts zero at the low end of the machine space; `direction` -1 counts from the high end downwards.
    `travel`, and `space` (its two ends in machine coordinates), are needed only if the controller does not report them.
    """

    name: AxisName
    letter: Literal["X", "Y", "Z", "A", "B", "C"]
    feed_per_min: Annotated[float, positive("1500")]
    origin: Annotated[float, option("0.0")] | None = None
    direction: Literal[1, -1] = 1
    travel: Annotated[float, positive("300")] | None = None
    space: Interval | None = None


@dataclass(frozen=True)
class Controls:
    """A controller's settings by number, the letters of its build options, and ends from FluidNC's configuration."""

    settings: Mapping[int, float]
    options: str = ""
    spaces: Mapping[int, tuple[float, float]] | None = None

    def bits(self, number: int) -> int:
        """`$number` as a mask; 0 if it is not reported."""
        return int(self.settings.get(number, 0))

    def flag(self, number: int) -> bool | None:
        """Whether bit 0 of `$number` is set (grblHAL uses the others, too); None if it is not reported."""
        return bool(self.bits(number) & 1) if number in self.settings else None

    @property
    def moves_unhomed(self) -> bool:
        """Whether it may move after power-up before homing: grblHAL, which alone has $44, unless $22 has 4."""
        return 44 in self.settings and not self.bits(22) & HOME_FIRST

    def positive(self, number: int, default: Default) -> float | Default:
        """`$number` if it is above 0, else `default`."""
        return self.settings.get(number) or default

    def margins(self, index: int) -> tuple[float, float]:
        """Clearance at both ends of `space`: with hard limits, a switch at an end would raise an alarm.

        If homing sets the origin, zero already has that clearance from the switch, and the other end is nearer by it.
        """
        off = self.positive(27, 0.0) if self.flag(21) else 0.0
        if not self.sets_origin(index):
            return off, off
        return (0.0, 2 * off) if self.homes_down(index) else (2 * off, 0.0)

    def homes_down(self, index: int) -> bool:
        """Whether the axis homes to the switch at its low end."""
        return bool(self.bits(23) >> index & 1)

    def space(self, index: int, length: float) -> tuple[float, float]:
        """Both ends of an axis in machine coordinates."""
        if self.spaces is not None and index in self.spaces:
            return self.spaces[index]
        return (0.0, length) if self.sets_origin(index) and self.homes_down(index) else (-length, 0.0)

    def sets_origin(self, index: int) -> bool:
        """Whether the position after homing becomes zero; FluidNC reports its ends instead."""
        known = self.spaces is not None and index in self.spaces
        return not known and ("Z" in self.options or bool(self.bits(22) & FORCE_ORIGIN))

    def homing_limit_s(self, lengths: Mapping[int, float]) -> float:
        """Time limit for homing axes of these lengths: twice the fast distance, and the slow one, for each cycle.

        Axes of one cycle move as far as the longest of them and, on one line, as fast as the slowest.
        Source: gnea/grbl limits.c, grblHAL/core machine_limits.c.
        """
        seek, feed = self.positive(25, 500.0), self.positive(24, 25.0)
        slow_way = self.positive(43, 1.0) * SEARCH_AGAIN * self.positive(27, 1.0)
        minutes = 0.0
        # axes that home together: from grblHAL's $44 to $49, else Z, then X with Y, then each of the others
        masks = [self.bits(44 + i) for i in range(6)]
        masks = masks if any(masks) else [0b100, 0b011, 0b1000, 0b10000, 0b100000]
        groups = [[i for i in lengths if mask >> i & 1] for mask in masks]
        homing_cycles = [together for together in groups if together]
        for together in homing_cycles:
            rate = min(self.positive(110 + i, seek) for i in together)
            longest = max(lengths[i] for i in together)
            minutes += 2 * SEARCH_AND_BACK * longest / min(seek, rate) + slow_way / min(feed, rate)
        return 10.0 + 60 * minutes


@dataclass(frozen=True)
class GrblEnvelope:
    """One configured axis within its controller's limits; converts between machine coordinates and the axis' own."""

    axis: GrblAxis
    index: int
    low: float
    high: float
    margins: tuple[float, float]
    rate_per_min: float
    acceleration_per_s2: float
    resolution: float

    @property
    def zero(self) -> float:
        """Machine coordinate of the axis' zero."""
        if self.axis.origin is not None:
            return self.axis.origin
        return self.low if self.axis.direction > 0 else self.high

    @property
    def travel(self) -> Travel:
        ends = (self.to_user(self.low + self.margins[0]), self.to_user(self.high - self.margins[1]))
        return Travel(*sorted(ends))

    def to_user(self, machine: float) -> float:
        """The axis' own coordinate."""
        return self.axis.direction * (machine - self.zero) + 0.0

    def to_machine(self, user: float) -> float:
        """The controller's coordinate."""
        return self.axis.direction * user + self.zero

    def homed_inside(self, machine: float) -> bool:
        """Whether a position after homing is consistent with this space."""
        return self.low - self.resolution <= machine <= self.high + self.resolution


def envelope(axis: GrblAxis, index: int, controls: Controls) -> GrblEnvelope | None:
    """The axis within its controller's limits; None if its length is neither configured nor reported."""
    length = controls.positive(130 + index, axis.travel)
    space = axis.space or (None if length is None else controls.space(index, length))
    if space is None:
        return None
    low, high = sorted(space)
    return GrblEnvelope(
        axis, index, low, high, controls.margins(index),
        rate_per_min=controls.positive(110 + index, axis.feed_per_min),
        acceleration_per_s2=controls.positive(120 + index, 10.0),
        resolution=max(1 / controls.positive(100 + index, 250.0), 0.001),
    )  # fmt: skip
