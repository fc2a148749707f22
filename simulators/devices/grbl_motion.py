"""The motion part of a GRBL controller: machine space, planned lines, switches, homing.

Lines begin and end at rest: there is no look-ahead at corners. The switch of an axis is at the end of its travel.
"""

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from simulators.devices.grbl_code import Code
from simulators.world.motion import Axis, brake_line, travel_line

NEVER = float("inf")
Place = tuple[float, ...]


@dataclass(frozen=True)
class Block:
    """One planned straight line, in machine space, mm/min; `scaled` by the feed or the rapid override."""

    target: Place
    feed: float
    jog: bool
    rapid: bool = False


class GrblMotion:
    """Axes by letter, in the firmware's order, executing one planned line after another."""

    def __init__(self, axes: Mapping[str, Axis], settings: dict[int, float], forced_origin: bool = False) -> None:
        self.axes = dict(axes)
        self.settings = settings
        self.forced_origin = forced_origin
        self.plan: deque[Block] = deque()
        self.current: Block | None = None
        self.end_s = NEVER
        self.trip_s = NEVER
        self.pressed: set[str] = set()
        self.overrides = [100, 100]  # feed and rapid, percent
        self.zero = [0.0] * len(axes)
        self.planned: Place = ()
        self.forget_place(0.0)

    def forget_place(self, now_s: float) -> None:
        """Power-up: the present position becomes zero."""
        self.zero = [axis.position(now_s) for axis in self.axes.values()]
        self.clear()
        self.planned = (0.0,) * len(self.axes)

    def clear(self) -> None:
        """Discard the plan; the current motion is the caller's responsibility."""
        self.plan.clear()
        self.current, self.end_s, self.trip_s = None, NEVER, NEVER

    def machine(self, now_s: float) -> Place:
        """The assumed machine position."""
        return tuple(
            axis.position(now_s) - zero + 0.0 for axis, zero in zip(self.axes.values(), self.zero, strict=True)
        )

    def feed(self, now_s: float) -> float:
        """The current feed, mm/min."""
        return 60 * math.hypot(*(axis.velocity(now_s) for axis in self.axes.values()))

    @property
    def busy(self) -> bool:
        """Whether anything moves or is planned."""
        return self.end_s != NEVER or bool(self.plan)

    def halt(self, now_s: float) -> None:
        """Stop at once, as without steps."""
        for axis in self.axes.values():
            if axis.moves(now_s):
                axis.halt(now_s)
        self.clear()

    def brake(self, now_s: float, *, keep: bool) -> None:
        """Decelerate; the interrupted line returns to the plan if it is to be kept."""
        if keep and self.current is not None:
            self.plan.appendleft(self.current)
        self.current, self.trip_s = None, NEVER
        if self.end_s != NEVER:
            self.end_s = brake_line(list(self.axes.values()), now_s, self._acceleration())

    def _acceleration(self) -> float:
        return min(self.settings[120 + i] for i in range(len(self.axes)))

    def _homes_down(self, at: int) -> bool:
        return bool(int(self.settings[23]) >> at & 1)

    def _space(self, at: int) -> tuple[float, float]:
        length = self.settings[130 + at]
        forced = self.forced_origin or bool(int(self.settings[22]) & 8)
        return (0.0, length) if forced and self._homes_down(at) else (-length, 0.0)

    def inside(self, target: Place) -> bool:
        spaces = [self._space(at) for at in range(len(target))]
        return all(low - 1e-9 <= value <= high + 1e-9 for value, (low, high) in zip(target, spaces, strict=True))

    def add(self, target: Place, feed: float, *, jog: bool = False, rapid: bool = False) -> None:
        """Plan a line; one of zero length is ignored."""
        if target != self.planned:
            self.plan.append(Block(target, feed, jog, rapid))
            self.planned = target

    def begin_next(self, now_s: float) -> bool:
        """Execute the next planned line, if there is one and nothing moves."""
        if self.end_s != NEVER or not self.plan:
            return False
        self.current = block = self.plan.popleft()
        where = [value + zero for value, zero in zip(block.target, self.zero, strict=True)]
        way = [abs(b - axis.position(now_s)) for axis, b in zip(self.axes.values(), where, strict=True)]
        length = math.hypot(*way)
        tops = [self.settings[110 + i] * length / part for i, part in enumerate(way) if part > 0]
        rises = [self.settings[120 + i] * length / part for i, part in enumerate(way) if part > 0]
        top = min(tops, default=block.feed)
        feed = top * self.overrides[1] / 100 if block.rapid else min(block.feed * self.overrides[0] / 100, top)
        rise = min(rises, default=1.0)
        self.end_s = travel_line(list(self.axes.values()), where, now_s, feed / 60, rise)
        crossings_s = (_crossing_s(axis, now_s, self.end_s) for axis in self.axes.values())
        self.trip_s = min(crossings_s, default=NEVER) if int(self.settings[21]) & 1 else NEVER
        return True

    def ended(self) -> None:
        """The line has ended, at its target or by deceleration."""
        self.end_s, self.trip_s, self.current = NEVER, NEVER, None

    def closed(self, now_s: float) -> str:
        """The letters of the closed switches."""
        return "".join(
            letter
            for letter, axis in self.axes.items()
            if letter in self.pressed or not axis.low < axis.position(now_s) < axis.high
        )

    def home(self, now_s: float) -> float:
        """Search all switches and pull off; returns the end time."""
        end_s = now_s
        for at, axis in enumerate(self.axes.values()):
            down = self._homes_down(at)
            switch = axis.low if down else axis.high
            off = switch + self.settings[27] * (1 if down else -1)
            found_s = travel_line([axis], [switch], now_s, self.settings[25] / 60, self._acceleration())
            end_s = max(end_s, travel_line([axis], [off], found_s, self.settings[24] / 60, self._acceleration()))
        return end_s

    def homed(self, now_s: float) -> None:
        """Set the present position to a pull-off from the switches, or to the origin where that is forced."""
        for at, axis in enumerate(self.axes.values()):
            low, high = self._space(at)
            off = self.settings[27]
            forced = self.forced_origin or bool(int(self.settings[22]) & 8)
            machine = 0.0 if forced else low + off if self._homes_down(at) else high - off
            self.zero[at] = axis.position(now_s) - machine
        self.planned = self.machine(now_s)


def _crossing_s(axis: Axis, begin_s: float, end_s: float) -> float:
    """When an axis moving in one direction reaches an end of its travel; NEVER if it does not, or was already there."""
    inside = [axis.low < axis.position(t) < axis.high for t in (begin_s, end_s)]
    if not inside[0] or inside[1]:
        return NEVER
    for _ in range(50):
        middle = (begin_s + end_s) / 2
        begin_s, end_s = (middle, end_s) if axis.low < axis.position(middle) < axis.high else (begin_s, middle)
    return end_s


# --- State of a simulated GRBL controller besides its settings: current activity and coordinate offsets ---


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
