"""Rails, gantries and pan-tilt heads on GRBL 1.1, grblHAL and FluidNC.

All motion is `$J=G53 G90` : absolute in machine space, refused outside the travel without an alarm, and cancellable.
`ok` means planned; a move is over when two reports in a row say Idle, and right when the position then is the target.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from drivers.clock import Clock, SystemClock
from drivers.errors import (
    BadConfiguration,
    DeviceError,
    EmergencyStopped,
    MoveFailed,
    NoAnswer,
    NotHomed,
)
from drivers.grbl_link import STILL, GrblLink, Report
from drivers.grbl_protocol import HOLD, JOG_CANCEL, RESET, Event
from drivers.interfaces import Condition, Identity, Transport, Travel
from drivers.moving import OneMover, check_arrival, check_target
from drivers.trust import HOME


@dataclass(frozen=True)
class GrblAxis:
    """One axis: its name with the unit, the controller's letter, its feed, and where its zero lies in machine space.

    `origin` None puts zero at the low end of the travel; `direction` -1 counts from the high end downwards.
    `travel` is needed only where the controller does not tell it ($130-$132).
    """

    name: str
    letter: str
    feed_per_min: float
    origin: float | None = None
    direction: int = 1
    travel: float | None = None


class GrblStage:
    """A Stage behind a GRBL controller."""

    def __init__(
        self,
        transport: Transport[Event],
        axes: Sequence[GrblAxis],
        *,
        clock: Clock | None = None,
        reset_on_open: str = "expect",
        poll_s: float = 0.2,
    ) -> None:
        self.clock = clock or SystemClock()
        self.link = GrblLink(transport)
        self._axes = tuple(axes)
        unknown = [axis.letter for axis in axes if axis.letter not in self.link.letters]
        if unknown:
            raise BadConfiguration(f"GRBL has no axis {', '.join(unknown)}", f"use letters of {self.link.letters}")
        self._reset_on_open = reset_on_open
        self._poll_s = poll_s
        self._one_mover = OneMover()
        self._homing = False
        self._stops = 0
        self._travel: dict[str, Travel] = {}

    @property
    def address(self) -> str:
        """The port or URL."""
        return self.link.address

    def connect(self) -> Identity:
        """Open, expect the greeting, ask version and settings; the stage is unhomed afterwards. Raises DeviceError."""
        identity = self.link.connect(reset=self._reset_on_open == "expect")
        try:
            self._check_limits()
            self._travel = {axis.name: self._travel_of(axis) for axis in self._axes}
            self._user(self.link.report())
        except DeviceError:
            self.link.close()
            raise
        return identity

    def _check_limits(self) -> None:
        for flag, name in ((20, "soft limits"), (22, "homing")):
            if self.link.setting(flag, 1.0) != 1.0:
                raise BadConfiguration(f"{name} are off at {self.address} (${flag}=0)", "set $22=1, then $20=1")

    def _travel_of(self, axis: GrblAxis) -> Travel:
        length = self.link.setting(130 + self._index(axis), axis.travel)
        if length is None:
            raise BadConfiguration(
                f"{self.address} does not tell the travel of {axis.letter}", "set travel for the axis"
            )
        ends = sorted(self._to_user(axis, machine, length) for machine in (-length, 0.0))
        return Travel(*ends)

    def _index(self, axis: GrblAxis) -> int:
        return self.link.letters.index(axis.letter)

    def _origin(self, axis: GrblAxis, length: float) -> float:
        if axis.origin is not None:
            return axis.origin
        return -length if axis.direction > 0 else 0.0

    def _to_user(self, axis: GrblAxis, machine: float, length: float) -> float:
        return axis.direction * (machine - self._origin(axis, length)) + 0.0

    def _to_machine(self, axis: GrblAxis, user: float) -> float:
        travel = self._travel[axis.name]
        return axis.direction * user + self._origin(axis, travel.high - travel.low)

    def close(self) -> None:
        """Give the line back."""
        self.link.close()

    def travel(self) -> Mapping[str, Travel]:
        """The range of each axis."""
        return dict(self._travel)

    def condition(self) -> Condition:
        """What it is doing, from the last report."""
        if not self.link.is_open:
            return Condition("not connected", False, "connect it")
        if (why := self.link.trust.why) is not None:
            return Condition(why.reason, False, why.remedy)
        return Condition(self.link.last_state.lower())

    def position(self) -> Mapping[str, float]:
        """Where the axes are now, in their own units. Raises DeviceError."""
        return self._user(self.link.settled_report())

    def _user(self, report: Report) -> dict[str, float]:
        there = {}
        for axis in self._axes:
            if self._index(axis) >= len(report.machine):
                told = f"{self.address} reports {len(report.machine)} axes, none for {axis.letter}"
                raise BadConfiguration(told, "correct the axis' letter")
            travel = self._travel[axis.name]
            there[axis.name] = self._to_user(axis, report.machine[self._index(axis)], travel.high - travel.low)
        return there

    def moving(self) -> bool:
        """Whether any axis moves. Raises DeviceError."""
        return self.link.report().state not in STILL

    def home(self) -> None:
        """Find the limit switches. Raises DeviceError."""
        with self._one_mover:
            epoch = self.link.recover()
            self._homing = True
            try:
                self.link.command("$H", timeout_s=self._homing_limit_s())
            finally:
                self._homing = False
            self.link.trust.give(epoch)

    def _homing_limit_s(self) -> float:
        """Twice the way GRBL searches (1.5 travels, $25 mm/min) and back, axis after axis."""
        seek = self.link.setting(25, None) or 500.0
        return 10.0 + sum(2 * 2.5 * (travel.high - travel.low) / seek * 60 for travel in self._travel.values())

    def move_to(self, **target: float) -> None:
        """Go there in a straight line and return when still. Raises DeviceError."""
        with self._one_mover:
            self.link.require_trust()
            check_target(target, self._travel)
            goal = dict(target)
            start = self.position()
            feed, duration_s = self._pace({name: goal[name] - start[name] for name in goal})
            if duration_s == 0.0:
                return
            words = " ".join(
                f"{axis.letter}{self._to_machine(axis, goal[axis.name]):.3f}"
                for axis in self._axes
                if axis.name in goal
            )
            stops = self._stops
            try:
                self.link.command(f"$J=G53 G90 G21 {words} F{feed:.1f}")
                report = self._until_still(duration_s)
            except DeviceError:
                self._give_up_moving()
                raise
            self._arrived(goal, self._user(report), stops)

    def _pace(self, way: Mapping[str, float]) -> tuple[float, float]:
        """Feed along the line so that no axis exceeds its own, and the seconds it takes."""
        length = math.hypot(*way.values())
        moved = [axis for axis in self._axes if abs(way.get(axis.name, 0.0)) > self._resolution(axis) / 2]
        if not moved:
            return 0.0, 0.0
        feed = min(axis.feed_per_min * length / abs(way[axis.name]) for axis in moved)
        acceleration = min(self.link.setting(120 + self._index(axis), 10.0) or 10.0 for axis in moved)
        return feed, length / feed * 60 + feed / 60 / acceleration

    def _resolution(self, axis: GrblAxis) -> float:
        return max(1 / (self.link.setting(100 + self._index(axis), 250.0) or 250.0), 0.001)

    def _until_still(self, duration_s: float) -> Report:
        """Two equal reports of Idle in a row. Raises NoAnswer when twice the time and two seconds have passed."""
        deadline_s = self.clock.now_s() + 2 * duration_s + 2
        before, pause_s = None, duration_s
        while True:
            self.link.pause(pause_s)
            report = self.link.report()
            if report.state == "Idle" and report == before:
                return report
            before = report
            if report.state in ("Door", "Hold", "Alarm", "Sleep"):
                raise MoveFailed(f"{self.address} stopped in state {report.state}", f"clear it, then {HOME}")
            if self.clock.now_s() > deadline_s:
                raise NoAnswer(
                    f"{self.address} still moves after {2 * duration_s + 2:.1f} s", "check feed and mechanics"
                )
            pause_s = 0.0 if report.state == "Idle" else self._poll_s

    def _arrived(self, goal: Mapping[str, float], there: Mapping[str, float], stops: int) -> None:
        for axis in self._axes:
            if axis.name in goal:
                tolerance = 1.5 * self._resolution(axis)
                check_arrival(axis.name, goal[axis.name], there[axis.name], tolerance, self._stops != stops)

    def _give_up_moving(self) -> None:
        """Leave nothing moving behind an error; what cannot be reached by now is beyond software."""
        try:
            if self.link.trust.why is None:
                self._cancel_jog()
        except DeviceError as error:
            self.link.trust.lose(error)

    def _cancel_jog(self) -> None:
        for _ in range(20):
            self.link.write(JOG_CANCEL)
            if self.link.report().state in STILL:
                return
            self.link.pause(self._poll_s)
        raise NoAnswer(f"{self.address} does not stop", "press the emergency stop at the bench")

    def stop(self) -> None:
        """Slow down and stay; while homing, reset. Raises DeviceError."""
        self._stops += 1
        if self._homing:
            self.link.trust.lose(NotHomed("homing was stopped", HOME))
            self.link.write(RESET)
            return
        self._cancel_jog()

    def emergency_stop(self) -> None:
        """Feed hold and soft reset past every lock; unsafe until homed."""
        self._stops += 1
        self.link.shout(HOLD + RESET, EmergencyStopped(f"emergency stop at {self.address}", "make it safe, then home"))
