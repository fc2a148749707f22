"""Zaber stages in ASCII: several devices on one chain, microsteps in, millimetres or degrees out.

Every command carries a checksum and a message id, so a late or damaged answer is never taken for another's. A move has
ended when the axis reports IDLE, found by polling and alerts, and succeeded if its position is the target.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from typing import Annotated

from drivers.clock import Clock, SystemClock
from drivers.errors import (
    Alarm,
    DeviceError,
    EmergencyStopped,
    MoveFailed,
    NoAnswer,
    Rejected,
    WasReset,
)
from drivers.homing_state import HOME, UNHOMED, Trust
from drivers.interfaces import Condition, Identity, Transport, Travel
from drivers.making import LineOptions
from drivers.move_checks import OneMover, check_arrival, check_target, left_still
from drivers.options import AxisName, PollInterval, axes, option, positive
from drivers.protocols.zaber import FLAGS, REJECTIONS, UNREFERENCED, Alert, Event, Reply, ZaberParser, checksum
from drivers.wire.connection import anything, not_connected, opened, roll_call
from drivers.wire.outgoing import URGENT_S

REPLY_S = 0.5
SPEED_UNIT = 1.6384  # of the setting per microstep per second, firmware 6 and 7
PRECISION_STEPS = 4
STOP_ALL = b"/0 0 stop\n"
"""Stops all devices of the chain; their replies carry no message id, so no request takes them."""


@dataclass(frozen=True)
class ZaberAxis:
    """One axis: its name with the unit, its place on the chain, units per microstep, its value at microstep 0.

    `speed_per_s` None keeps the device's speed.
    """

    name: AxisName
    device: Annotated[int, option("1", least=1, most=99)]
    unit_per_step: Annotated[float, positive("0.000234375")]
    axis: Annotated[int, option("1", least=1, most=9)] = 1
    zero: Annotated[float, option("0.0")] = 0.0
    speed_per_s: Annotated[float, positive("10")] | None = None

    def to_steps(self, value: float) -> int:
        """The nearest microstep."""
        return round((value - self.zero) / self.unit_per_step)

    def to_unit(self, steps: float) -> float:
        """The position of a microstep."""
        return self.zero + steps * self.unit_per_step


class ZaberStage:
    """A Stage of Zaber devices."""

    def __init__(
        self,
        transport: Transport[Event],
        axes: Sequence[ZaberAxis],
        *,
        clock: Clock | None = None,
        poll_s: float = 0.1,
    ) -> None:
        self.clock = clock or SystemClock()
        self.trust = Trust()
        self._transport = transport
        self._axes = tuple(axes)
        self._poll_s = poll_s
        self._ids = 0
        self._checking: set[int] = set()
        self._alerts = 0
        self._one_mover = OneMover()
        self._travel: dict[str, Travel] = {}
        self._speed: dict[str, float] = {}

    @property
    def address(self) -> str:
        """The port or URL."""
        return self._transport.address

    def connect(self) -> Identity:
        """Open, identify every device, read limits, set speeds. Raises DeviceError naming all missing devices."""
        self._transport.close()
        self.trust.lose(UNHOMED)
        self._checking.clear()
        with opened(self._transport, self._hear):
            identities = self._roll_call()
            for axis in self._axes:
                self._prepare(axis)
        self.trust.why = UNHOMED
        models, versions, serials = ("; ".join(dict.fromkeys(column)) for column in zip(*identities, strict=True))
        return Identity(f"Zaber {models}", versions, serials, self.address)

    def _roll_call(self) -> list[tuple[str, str, str]]:
        where, remedy = f"{self.address}: no answer from devices", "check power, cables, addresses"
        return roll_call((axis.device for axis in self._axes), self._introduce, where, remedy)

    def _introduce(self, device: int) -> tuple[str, str, str]:
        """Model, version and serial number; checksums from here on."""
        self._query(device, 0, "set comm.checksum 1")
        self._checking.add(device)
        model, version, serial = (self._query(device, 0, f"get {s}") for s in ("deviceid", "version", "system.serial"))
        return model, version, serial

    def _prepare(self, axis: ZaberAxis) -> None:
        self._query(axis.device, 0, "set comm.alert 1")
        ends = [axis.to_unit(self._number(axis, f"limit.{end}")) for end in ("min", "max")]
        self._travel[axis.name] = Travel(min(ends), max(ends))
        if axis.speed_per_s is not None:
            setting = round(axis.speed_per_s / abs(axis.unit_per_step) * SPEED_UNIT)
            self._query(axis.device, axis.axis, f"set maxspeed {setting}")
        steps_per_s = self._number(axis, "maxspeed") / SPEED_UNIT
        self._speed[axis.name] = steps_per_s * abs(axis.unit_per_step)

    def close(self) -> None:
        """Release the line; the position is not trusted afterwards."""
        self.trust.lose(UNHOMED)
        self._transport.close()

    def condition(self) -> Condition:
        """Whether it may move."""
        return self.trust.refusal(self._transport.is_open) or Condition("idle")

    def _send(
        self, device: int, axis: int, command: str, tries: int = 1, allowed: Callable[[], None] = anything
    ) -> Reply:
        self._ids = number = (self._ids + 1) % 100
        body = f"{device} {axis} {number} {command}".rstrip().encode()

        unchecked: list[Reply] = []

        def answer(event: Event) -> Reply | None:
            if not isinstance(event, Reply) or (event.device, event.number) != (device, number):
                return None
            # with checksums enabled, an answer without one was damaged at its colon, or the device was reset
            if event.checked or device not in self._checking:
                return event
            unchecked.append(event)
            return None

        order = b"/" + body + b":" + checksum(body) + b"\n"
        try:
            reply = self._transport.request(order, answer, REPLY_S, tries, allowed)
        except NoAnswer as error:
            if len(unchecked) < 2:
                raise
            reset = WasReset(f"device {device} at {self.address} was switched off and on, or reset", HOME)
            self.trust.lose(reset)
            raise reset from error
        if not reply.accepted:
            reason, remedy = REJECTIONS.get(reply.data, (f"it answered {reply.data}", "see the device's manual"))
            raise Rejected(f"{self.address} device {device} refused {command!r}: {reason}", remedy, reply.data)
        return reply

    def _query(self, device: int, axis: int, command: str) -> str:
        """A query, which may be repeated if unanswered."""
        return self._send(device, axis, command, tries=3).data

    def _number(self, axis: ZaberAxis, setting: str) -> float:
        value = self._query(axis.device, axis.axis, f"get {setting}")
        try:
            return float(value)
        except ValueError as error:
            raise Rejected(
                f"{self.address} device {axis.device} reports {setting} as {value!r}", "check the axis' number", value
            ) from error

    def _hear(self, event: Event, host_s: float) -> None:
        if isinstance(event, Alert):
            self._alerts += 1

    def travel(self) -> Mapping[str, Travel]:
        """The range of each axis."""
        return dict(self._travel)

    def position(self) -> Mapping[str, float]:
        """Where the axes are now. Raises DeviceError."""
        return {axis.name: axis.to_unit(self._steps(axis)) for axis in self._axes}

    def _steps(self, axis: ZaberAxis) -> float:
        return self._number(axis, "pos")

    def moving(self) -> bool:
        """Whether any axis moves. Raises DeviceError."""
        return any(self._status(axis).busy for axis in self._axes)

    def _status(self, axis: ZaberAxis) -> Reply:
        return self._send(axis.device, axis.axis, "", tries=3)

    def _check_flag(self, axis: ZaberAxis, flag: str) -> None:
        reason, remedy = FLAGS.get(flag, (f"flag {flag}", "see the device's manual"))
        if flag.startswith("F"):
            error = Alarm(f"{axis.name} at {self.address}: {reason}", remedy, flag)
            self.trust.lose(error)
            raise error
        if flag in (*UNREFERENCED, "WL", "WM"):
            self.trust.lose(Alarm(f"{axis.name} at {self.address}: {reason}", remedy, flag))
            self.trust.require()

    def home(self, allowed: Callable[[], None] = anything) -> None:
        """Send every axis to its home sensor. Raises DeviceError."""
        with self._one_mover as stops:
            self._require_line()
            epoch = self.trust.begin(self.trust.preemptions)
            undisturbed = self._one_mover.unless_stopped(stops, allowed, partial(self.trust.undisturbed, epoch))
            with self._left_still(self._axes):
                for axis in self._axes:
                    self._send(axis.device, axis.axis, "warnings clear", tries=3)
                    self._send(axis.device, axis.axis, "home", allowed=undisturbed)
                longest_s = max((travel.high - travel.low) / self._speed[name] for name, travel in self._travel.items())
                self._finish(list(self._axes), 4 * longest_s + 10)
                if self._one_mover.stopped(stops) or any(self._status(axis).flag == "NI" for axis in self._axes):
                    raise MoveFailed(f"homing at {self.address} was interrupted", HOME)
            self.trust.give(epoch)

    def _require_line(self) -> None:
        if not self._transport.is_open:
            raise not_connected(self.address)

    def move_to(self, **target: float) -> None:
        """Move the axes independently, and return when all are still. Raises DeviceError."""
        with self._one_mover as stops:
            self._require_line()
            self.trust.require()
            check_target(target, self._travel)
            goals = {axis: target[axis.name] for axis in self._axes if axis.name in target}
            start, may_go = self.position(), self._one_mover.unless_stopped(stops, self.trust.require)
            longest_s = max((abs(goals[a] - start[a.name]) / self._speed[a.name] for a in goals), default=0.0)
            with self._left_still(goals):
                for axis, value in goals.items():
                    self._send(axis.device, axis.axis, f"move abs {axis.to_steps(value)}", allowed=may_go)
                self._finish(list(goals), 2 * longest_s + 2)
                stopped = self._one_mover.stopped(stops)
                for axis, value in goals.items():
                    tolerance = PRECISION_STEPS * abs(axis.unit_per_step)
                    check_arrival(axis.name, value, axis.to_unit(self._steps(axis)), tolerance, stopped)

    def _finish(self, axes: list[ZaberAxis], limit_s: float) -> None:
        """Wait until the axes are idle, and check their flags. Raises NoAnswer after the limit."""
        deadline_s, epoch = self.clock.now_s() + limit_s, self.trust.epoch
        while axes:
            status = self._status(axes[0])
            self._check_flag(axes[0], status.flag if not (status.busy and status.flag in UNREFERENCED) else "--")
            if not status.busy:
                axes.pop(0)
                continue
            if self.clock.now_s() > deadline_s:
                raise NoAnswer(f"{axes[0].name} still moves after {limit_s:.1f} s", "check speed and mechanics")
            self._pause(epoch)

    def _pause(self, epoch: int) -> None:
        """Wait until the next poll; an alert shortens it, an emergency stop ends it."""
        alerts = self._alerts
        self._transport.wait(lambda: self._alerts != alerts or self.trust.epoch != epoch, self._poll_s)
        if self.trust.epoch != epoch:
            self.trust.require()

    def _left_still(self, axes: Iterable[ZaberAxis]) -> AbstractContextManager[None]:
        return left_still(partial(self._halt, tuple(axes)), self.emergency_stop, self.trust)

    def _halt(self, axes: Iterable[ZaberAxis]) -> None:
        failures = [error for axis in axes if (error := self._halt_axis(axis)) is not None]
        if failures:
            raise failures[0]

    def _halt_axis(self, axis: ZaberAxis) -> DeviceError | None:
        """The reason why it may not stop; the order is repeated, as a damaged one may be refused."""
        failure: DeviceError | None = None
        for _ in range(2):
            try:
                self._send(axis.device, axis.axis, "stop", tries=3)
            except DeviceError as error:
                failure = error
            else:
                return None
        return failure

    def stop(self) -> None:
        """Decelerate and stay: sent at once without queueing, then confirmed. Raises DeviceError."""
        self._one_mover.stop()
        try:
            self._transport.write(STOP_ALL, within_s=URGENT_S)
        except NoAnswer:
            self.emergency_stop()
            raise
        self._halt(self._axes)

    def emergency_stop(self) -> None:
        """Stop all devices of the chain without deceleration, ahead of every lock; unsafe until homed."""
        self._one_mover.stop()
        error = EmergencyStopped(f"emergency stop at {self.address}", f"make it safe, then {HOME}")
        self.trust.preempt(error)
        self._transport.preempt(b"\n/0 0 estop\n", error)


@dataclass(frozen=True, kw_only=True)
class ZaberOptions(LineOptions):
    """Options of driver "zaber"."""

    makes = ZaberStage
    parser = ZaberParser
    axes: Annotated[tuple[ZaberAxis, ...], axes("device", "axis")]
    poll_s: PollInterval = 0.1
