"""Messages of GRBL 1.1, grblHAL and FluidNC: bytes to events, and their codes with reason and remedy.

Every command line is answered by exactly one `Ok` or `Failed`; all other messages are unsolicited.
Sources: gnea/grbl doc/markdown/interface.md, jogging.md, doc/csv; grblHAL/core errors.h, alarms.h.
"""

import re
from dataclasses import dataclass, field

from drivers.protocols.framing import LineSplitter, UnrecognisedLine, numbered

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
DOOR_MESSAGE = "Check Door"
"""The message of an opened door; grblHAL's reports show a jog paused by it as still running."""
MOTORS_HELD = 255.0
"""`$1`: milliseconds after which motors at rest are released; this value keeps them on."""


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
    sub: int = 0
    fields: dict[str, str] = field(default_factory=dict)

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


class GrblParser:
    """Bytes to events, one per line."""

    def __init__(self) -> None:
        self._lines = LineSplitter()

    def feed(self, data: bytes) -> list[Event]:
        """The events completed by these bytes."""
        return [read_line(line) for line in self._lines.feed(data)]
