"""Limits of an axis according to the settings of a GRBL-like controller: travel, speed, acceleration.

Machine space is `[-L, 0]` on plain GRBL. Where homing sets the origin (`Z` among the options of `$I`, bit 3 of
grblHAL's `$22`) it begins at the switch: `[0, L]` for an axis that homes downwards. FluidNC reports its ends.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

from drivers.interfaces import Travel
from drivers.options import AxisName, Interval, option, positive

FORCE_ORIGIN = 8
"""Bit of grblHAL's `$22`: homing sets the origin."""
HOME_FIRST = 4
"""Bit of grblHAL's `$22`: locked after power-up until homed, as GRBL always is."""
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

    def setting(self, number: int, default: float | None = None) -> float | None:
        """`$number`, or `default` if the controller does not report it."""
        return self.settings.get(number, default)

    def flag(self, number: int) -> bool | None:
        """Whether bit 0 of `$number` is set (grblHAL uses the others, too); None if it is not reported."""
        value = self.settings.get(number)
        return None if value is None else bool(int(value) & 1)

    @property
    def moves_unhomed(self) -> bool:
        """Whether it may move after power-up before homing: grblHAL, which alone has $44, unless $22 has 4."""
        return self.setting(44) is not None and not int(self.setting(22) or 0) & HOME_FIRST

    def positive(self, number: int, default: float | None = None) -> float | None:
        """`$number` if it is above 0, else `default`."""
        value = self.settings.get(number)
        return value if value else default

    def margins(self, index: int) -> tuple[float, float]:
        """Clearance at both ends of `space`: with hard limits, a switch at an end would raise an alarm.

        If homing sets the origin, zero already has that clearance from the switch, and the other end is nearer by it.
        """
        off = (self.setting(27) or 0.0) if self.flag(21) else 0.0
        if not self.sets_origin(index):
            return off, off
        return (0.0, 2 * off) if self.homes_down(index) else (2 * off, 0.0)

    def homes_down(self, index: int) -> bool:
        """Whether the axis homes to the switch at its low end."""
        return bool(int(self.setting(23) or 0) >> index & 1)

    def space(self, index: int, length: float) -> tuple[float, float]:
        """Both ends of an axis in machine coordinates."""
        if self.spaces is not None and index in self.spaces:
            return self.spaces[index]
        return (0.0, length) if self.sets_origin(index) and self.homes_down(index) else (-length, 0.0)

    def sets_origin(self, index: int) -> bool:
        """Whether the position after homing becomes zero; FluidNC reports its ends instead."""
        known = self.spaces is not None and index in self.spaces
        return not known and ("Z" in self.options or bool(int(self.setting(22) or 0) & FORCE_ORIGIN))

    def homing_limit_s(self, lengths: Mapping[int, float]) -> float:
        """Time limit for homing axes of these lengths: twice the fast distance, and the slow one, for each cycle.

        Axes of one cycle move as far as the longest of them and, on one line, as fast as the slowest.
        Source: gnea/grbl limits.c, grblHAL/core machine_limits.c.
        """
        seek, feed = self.positive(25, 500.0) or 500.0, self.positive(24, 25.0) or 25.0
        slow_way = (self.positive(43, 1.0) or 1.0) * SEARCH_AGAIN * (self.positive(27, 1.0) or 1.0)
        minutes = 0.0
        for together in self._homing_cycles(lengths):
            rate = min(self.positive(110 + i, seek) or seek for i in together)
            longest = max(lengths[i] for i in together)
            minutes += 2 * SEARCH_AND_BACK * longest / min(seek, rate) + slow_way / min(feed, rate)
        return 10.0 + 60 * minutes

    def _homing_cycles(self, axes: Iterable[int]) -> list[list[int]]:
        """Axes that home together: from grblHAL's $44 to $49, else Z, then X with Y, then each of the others."""
        masks = [int(self.setting(44 + i) or 0) for i in range(6)]
        masks = masks if any(masks) else [0b100, 0b011, 0b1000, 0b10000, 0b100000]
        groups = [[i for i in axes if mask >> i & 1] for mask in masks]
        return [together for together in groups if together]


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
    rate = controls.positive(110 + index, axis.feed_per_min) or axis.feed_per_min
    acceleration = controls.positive(120 + index, 10.0) or 10.0
    steps = controls.positive(100 + index, 250.0) or 250.0
    low, high = sorted(space)
    return GrblEnvelope(axis, index, low, high, controls.margins(index), rate, acceleration, max(1 / steps, 0.001))
