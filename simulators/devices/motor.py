"""A motor with a reference switch at the low end of its axis, and what controllers of such motors have in common."""

from collections.abc import Hashable, Iterable, Mapping
from typing import Generic, TypeVar

from simulators.devices.serial_device import SerialDevice, drained
from simulators.world.motion import Axis, brake_line, travel_line

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
