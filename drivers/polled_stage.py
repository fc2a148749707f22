"""Stages whose axes are polled: connecting, homing, moves and stops once, over a few orders of each protocol.

A move has ended when every axis reports twice that it stands at the same position: the protocols have no checksums, so
one reading may be damaged. A stop is repeated until the axes stand. An axis that has lost its reference ends all trust.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Generic, NamedTuple, Protocol, TypeVar

from drivers.errors import Clock, DeviceError, EmergencyStopped, MoveFailed, NoAnswer, Rejected, SystemClock, WasReset
from drivers.interfaces import Condition, Identity, Transport, Travel
from drivers.move_checks import HOME, UNHOMED, OneMover, Trust, check_arrival, check_target, left_still
from drivers.options import AxisName, interval, option, positive
from drivers.wire.connection import URGENT_S, InStepLine, anything, not_connected, opened


class StageAxis(Protocol):
    """An axis of a polled stage: its name with the unit, and the tolerance of its positions."""

    @property
    def name(self) -> str:
        """Its name with the unit."""

    @property
    def tolerance(self) -> float:
        """The largest error of a move."""


E = TypeVar("E")
A = TypeVar("A", bound=StageAxis)
REPLY_S = 0.3
STOP_S = 6.0  # how long a stop is repeated
READINGS = 4  # how often a position is read until two readings agree


class AxisState(NamedTuple):
    """An axis as reported: its position in its unit, whether it moves, and whether its position has a reference."""

    position: float
    moving: bool
    referenced: bool = True


@dataclass(frozen=True)
class PolledAxis:
    """One axis: its name with the unit, and its number or identifier at the controller.

    scale : the axis' unit per unit of the controller, negative if that counts in the opposite direction
    zero : the value where the controller has 0
    travel : the range; None asks the controller
    speed_per_s : None keeps the controller's
    tolerance : of positions
    """

    name: AxisName
    number: int | str = 1
    scale: Annotated[float, option("1.0", "a number other than 0", holds=bool)] = 1.0
    zero: Annotated[float, option("0.0")] = 0.0
    travel: Annotated[tuple[float, float], interval("[0.0, 100.0]")] | None = None
    speed_per_s: Annotated[float, positive("10")] | None = None
    tolerance: Annotated[float, positive("0.002")] = 0.002

    def to_device(self, value: float) -> float:
        """The controller's number of a position."""
        return (value - self.zero) / self.scale

    def to_unit(self, value: float) -> float:
        """The position of a controller's number."""
        return self.zero + value * self.scale

    def travel_between(self, *ends: float) -> Travel:
        """The configured range, or that between the controller's `ends`."""
        low, high = self.travel or sorted(map(self.to_unit, ends))
        return Travel(low, high)


class AxisStage(ABC, Generic[E, A]):
    """A Stage over the orders that a driver implements, for axes of its own kind; `PolledStage` with `PolledAxis`."""

    stop_bytes: bytes  # stop all axes, whatever was sent before; written again and again until they stand
    emergency_bytes = b""  # stop them without deceleration, where the protocol has such an order
    has_checksums = False  # one reading is enough

    def __init__(
        self, transport: Transport[E], axes: Sequence[A], *, clock: Clock | None = None, poll_s: float = 0.1
    ) -> None:
        self.clock = clock or SystemClock()
        self.trust = Trust()
        self._transport, self._axes, self._poll_s = transport, tuple(axes), poll_s
        self._line = InStepLine(transport, REPLY_S)
        self._mover = OneMover()
        self.power: Callable[[], AbstractContextManager[None]] = nullcontext
        """Context of a move: a watchdog keeps the motors enabled within."""
        self._travel: dict[str, Travel] = {}
        self._speed: dict[str, float] = {}
        self._alerts = 0

    # --- what a driver implements

    @abstractmethod
    def _introduce(self) -> tuple[str, str, str]:
        """Model, firmware and serial number. Raises DeviceError."""

    @abstractmethod
    def _prepare(self, axis: A) -> tuple[Travel, float]:
        """The axis' range and speed, once its settings are made. Raises DeviceError."""

    @abstractmethod
    def _state(self, axis: A) -> AxisState:
        """The axis' state. Raises DeviceError."""

    @abstractmethod
    def _begin_homing(self, axis: A, allowed: Callable[[], None]) -> None:
        """Order the search for the reference, and have it acknowledged. Raises DeviceError."""

    @abstractmethod
    def _begin_move(self, axis: A, value: float, allowed: Callable[[], None]) -> None:
        """Order a move to this position, and have it acknowledged. Raises DeviceError."""

    def _check_homed(self, states: Mapping[A, AxisState]) -> None:
        """Raises MoveFailed if these states cannot be those of axes that have homed."""

    def _homing_limit_s(self) -> float:
        return 4 * max((t.high - t.low) / self._speed[name] for name, t in self._travel.items()) + 10

    def _duration_s(self, axis: A, way: float) -> float:
        """Duration of a move of this length, in the axis' unit."""
        return way / self._speed[axis.name]

    def _hear(self, event: E, host_s: float) -> None:
        """An event that nobody has requested. A driver that counts it in `_alerts` is polled at once."""

    # --- the stage

    @property
    def address(self) -> str:
        return self._transport.address

    def connect(self) -> Identity:
        """Open the line, identify the controller, read travel and speed of each axis. Raises DeviceError."""
        self._transport.close()
        self.trust.lose(UNHOMED)
        self._line.owed = None
        with opened(self._transport, self._hear):
            identity = Identity(*self._introduce(), self.address)
            for axis in self._axes:
                self._travel[axis.name], speed = self._prepare(axis)
                if speed <= 0:
                    reason = f"{axis.name} at {self.address} reports a speed of {speed:g}"
                    raise Rejected(reason, "connect again, or set speed_per_s of the axis")
                self._speed[axis.name] = speed
        self.trust.why = UNHOMED
        return identity

    def close(self) -> None:
        """Release the line; the position is not trusted afterwards."""
        self.trust.lose(UNHOMED)
        self._transport.close()

    def condition(self) -> Condition:
        """Whether it may move."""
        return self.trust.refusal(self._transport.is_open) or Condition("idle")

    def travel(self) -> Mapping[str, Travel]:
        """The range of each axis; known after `connect`."""
        return dict(self._travel)

    def position(self) -> Mapping[str, float]:
        """Where the axes are now. Raises DeviceError."""
        return {axis.name: self._reading(axis) for axis in self._axes}

    def _reading(self, axis: A) -> float:
        """The position that two readings agree on, the last one of an axis that moves."""
        last = self._checked(axis).position
        for _ in range(0 if self.has_checksums else READINGS - 1):
            before, last = last, self._checked(axis).position
            if abs(before - last) <= axis.tolerance:
                break
        return last

    def _checked(self, axis: A) -> AxisState:
        """The axis' state. Raises WasReset if a homed axis has lost its reference."""
        state = self._state(axis)
        if not state.referenced and self.trust.why is None:
            self.trust.lose(WasReset(f"{axis.name} at {self.address} has lost its reference", HOME))
            self.trust.require()
        return state

    def moving(self) -> bool:
        """Whether any axis moves. Raises DeviceError."""
        return any(self._state(axis).moving for axis in self._axes)

    def home(self, allowed: Callable[[], None] = anything) -> None:
        """Send every axis to its reference. Raises DeviceError."""
        with self._mover as stops:
            self._require_line()
            epoch = self.trust.begin(self.trust.preemptions)
            may_go = self._mover.unless_stopped(stops, allowed, partial(self.trust.undisturbed, epoch))
            with self.power(), self._left_still():
                for axis in self._axes:
                    self._begin_homing(axis, may_go)
                states = self._rest(self._axes, self._homing_limit_s())
                if self._mover.stopped(stops) or not all(state.referenced for state in states.values()):
                    raise MoveFailed(f"homing at {self.address} was interrupted", HOME)
                self._check_homed(states)
            self.trust.give(epoch)

    def _require_line(self) -> None:
        if not self._transport.is_open:
            raise not_connected(self.address)

    def move_to(self, **target: float) -> None:
        """Move the axes independently, and return when all are still. Raises DeviceError."""
        with self._mover as stops:
            self._require_line()
            self.trust.require()
            check_target(target, self._travel)
            goals = {axis: target[axis.name] for axis in self._axes if axis.name in target}
            may_go = self._mover.unless_stopped(stops, self.trust.require)
            durations_s = (self._duration_s(axis, abs(value - self._reading(axis))) for axis, value in goals.items())
            longest_s = max(durations_s, default=0.0)
            with self.power(), self._left_still():
                for axis, value in goals.items():
                    self._begin_move(axis, value, may_go)
                there = self._rest(goals, 2 * longest_s + 2)
                for axis, value in goals.items():
                    stopped = self._mover.stopped(stops)
                    check_arrival(axis.name, value, there[axis].position, axis.tolerance, stopped)

    def _rest(self, axes: Iterable[A], limit_s: float) -> dict[A, AxisState]:
        """The states of axes that stand. Raises NoAnswer after the limit, and an emergency stop."""
        deadline_s, epoch = self.clock.now_s() + limit_s, self.trust.epoch
        before: dict[A, AxisState] = {}
        while not self._stand(states := {axis: self._checked(axis) for axis in axes}, before):
            if self.clock.now_s() > deadline_s:
                raise NoAnswer(f"{self.address} still moves after {limit_s:.1f} s", "check speed and mechanics")
            before = states
            self._pause(epoch)
        return states

    def _pause(self, epoch: int) -> None:
        """Wait until the next poll; an alert shortens it, an emergency stop ends it."""
        alerts = self._alerts
        self._transport.wait(lambda: self._alerts != alerts or self.trust.epoch != epoch, self._poll_s)
        self.trust.undisturbed(epoch)

    def _stand(self, states: Mapping[A, AxisState], before: Mapping[A, AxisState]) -> bool:
        """Whether the axes report that they stand, where they were before."""
        stand = not any(state.moving for state in states.values())
        return stand and (
            self.has_checksums
            or all(
                axis in before and abs(state.position - before[axis].position) <= axis.tolerance
                for axis, state in states.items()
            )
        )

    def _left_still(self) -> AbstractContextManager[None]:
        return left_still(self._halt, self.emergency_stop, self.trust)

    def _halt(self) -> None:
        """Repeat the stop until all axes stand. Raises DeviceError."""
        deadline_s = self.clock.now_s() + STOP_S
        before: dict[A, AxisState] = {}
        failure: DeviceError
        while True:
            self._transport.write(self.stop_bytes, within_s=URGENT_S)
            try:
                states = {axis: self._state(axis) for axis in self._axes}
                if self._stand(states, before):
                    return
                before, failure = states, NoAnswer(f"{self.address} does not stop", "switch it off")
            except (NoAnswer, Rejected) as error:
                failure = error
            if self.clock.now_s() > deadline_s:
                raise failure
            self.clock.sleep(self._poll_s / 2)

    def stop(self) -> None:
        """Decelerate and stay: sent at once without queueing, then confirmed. Raises DeviceError."""
        self._mover.stop()
        self._require_line()
        try:
            self._transport.write(self.stop_bytes, within_s=URGENT_S)
        except NoAnswer:
            self.emergency_stop()
            raise
        self._halt()

    def lose_position(self, error: DeviceError) -> None:
        """Stop, and refuse to move with `error` until homed; never raises."""
        self._mover.stop()
        self.trust.lose(error)
        self._transport.preempt(self.stop_bytes, error)

    def emergency_stop(self) -> None:
        """Stop ahead of every lock; unsafe until homed."""
        self._mover.stop()
        error = EmergencyStopped(f"emergency stop at {self.address}", f"make it safe, then {HOME}")
        self.trust.preempt(error)
        self._transport.preempt(self.emergency_bytes or self.stop_bytes, error)


PolledStage = AxisStage[E, PolledAxis]  # the base of most drivers
