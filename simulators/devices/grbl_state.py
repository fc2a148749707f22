"""State of a simulated GRBL controller besides its settings: current activity and coordinate offsets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from simulators.devices.grbl_code import Code
from simulators.devices.grbl_motion import NEVER


@dataclass(frozen=True)
class Outputs:
    """Callbacks of the controller's relay and spindle outputs."""

    relay: Callable[[bool, float], None] = lambda on, now_s: None
    spindle: Callable[[float, float], None] = lambda level, now_s: None


@dataclass
class Activity:
    """Current activity, and what blocks the main loop.

    `waiting` is a line that waits until nothing moves; `owed` a response due at the end of a pause; `limit`: the
    machine decelerates for the alarm of a target outside; `reported_state` replaces the state in reports, if not
    empty.
    """

    state: str = "Alarm"
    braking: bool = False
    homing: bool = False
    waiting: Code | None = None
    dwelling: Code | None = None
    busy_until_s: float = NEVER
    owed: str = ""
    limit: bool = False
    reported_state: str = ""


@dataclass
class Offsets:
    """Coordinate systems and stored positions by their G number; offsets of G92 and G43.1."""

    axes: int
    names: tuple[float, ...] = (54, 55, 56, 57, 58, 59, 28, 30)
    systems: dict[float, tuple[float, ...]] = field(default_factory=dict)
    shift: tuple[float, ...] = ()
    length: float = 0.0

    def __post_init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Set all to zero."""
        none = (0.0,) * self.axes
        self.systems = dict.fromkeys(self.names, none)
        self.shift, self.length = none, 0.0

    def total(self, system: int) -> tuple[float, ...]:
        """Work zero in machine space."""
        lengths = [0.0] * self.axes
        if self.axes > 2:
            lengths[2] = self.length
        return tuple(a + b + c for a, b, c in zip(self.systems[system], self.shift, lengths, strict=True))
