"""What a simulated GRBL controller remembers besides its settings: what is going on, and where it counts from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from simulators.devices.grbl_code import Code
from simulators.devices.grbl_motion import NEVER


@dataclass(frozen=True)
class Outputs:
    """What hangs on the controller's relay and spindle pins."""

    relay: Callable[[bool, float], None] = lambda on, now_s: None
    spindle: Callable[[float, float], None] = lambda level, now_s: None


@dataclass
class Run:
    """What is going on, and what the main loop waits for.

    `waiting` is a line that waits until nothing moves; `owed` a response that comes when a pause is over; `limit` tells
    that a target outside was seen and the machine slows down for its alarm; `told` is what reports call the state, if
    it is not that.
    """

    state: str = "Alarm"
    braking: bool = False
    homing: bool = False
    waiting: Code | None = None
    dwelling: Code | None = None
    busy_until_s: float = NEVER
    owed: str = ""
    limit: bool = False
    told: str = ""


@dataclass
class Offsets:
    """Coordinate systems and kept places by their G number; what G92 and G43.1 have set."""

    axes: int
    names: tuple[float, ...] = (54, 55, 56, 57, 58, 59, 28, 30)
    systems: dict[float, tuple[float, ...]] = field(default_factory=dict)
    shift: tuple[float, ...] = ()
    length: float = 0.0

    def __post_init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """All zero."""
        none = (0.0,) * self.axes
        self.systems = dict.fromkeys(self.names, none)
        self.shift, self.length = none, 0.0

    def total(self, system: int) -> tuple[float, ...]:
        """Work zero in machine space."""
        lengths = [0.0] * self.axes
        if self.axes > 2:
            lengths[2] = self.length
        return tuple(a + b + c for a, b, c in zip(self.systems[system], self.shift, lengths, strict=True))
