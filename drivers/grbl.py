"""Rails, gantries and pan-tilt heads on GRBL 1.1, grblHAL and FluidNC.

All motion is `$J=G53 G90` : absolute in machine space, refused outside the travel without an alarm, and cancellable.
`ok` means planned; a move has ended when two reports in a row say Idle, and succeeded if it is at the target.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import partial
from typing import Annotated, ClassVar, Literal

from drivers.errors import (
    BadConfiguration,
    Clock,
    DeviceError,
    EmergencyStopped,
    Held,
    MoveFailed,
    NoAnswer,
    NotHomed,
    Rejected,
    SystemClock,
    WasReset,
)
from drivers.interfaces import Caveat, Condition, Identity, Transport, Travel
from drivers.making import LineOptions, MakerContext
from drivers.move_checks import HOME, OneMover, check_arrival, check_target, in_turn, left_still
from drivers.options import ENABLED_STAGE, GRBL_STAGE, PollInterval, axes
from drivers.protocols.grbl import (
    DOOR_MESSAGE,
    HOLD,
    JOG_CANCEL,
    MOTORS_HELD,
    PAUSES,
    RESET,
    RESUMABLE,
    RESUME,
    Event,
    GrblAxis,
    GrblEnvelope,
    GrblParser,
    envelope,
)
from drivers.protocols.grbl_link import GrblLink, StatusReport
from drivers.wire.connection import anything, closed_after_errors

RESUME_S = 5.0  # time limit for a controller to resume after its door was closed


class GrblStage:
    """A Stage behind a GRBL controller."""

    def __init__(
        self, transport: Transport[Event], axes: Sequence[GrblAxis], *, clock: Clock | None = None,
        reset_on_open: str = "expect", poll_s: float = 0.2,
    ) -> None:  # fmt: skip
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
        self.power: Callable[[], AbstractContextManager[None]] = nullcontext
        """Context of a move: a watchdog keeps the motors enabled within."""
        self._envelopes: dict[str, GrblEnvelope] = {}

    @property
    def address(self) -> str:
        return self.link.address

    def connect(self) -> Identity:
        """Open, await the greeting, read version and settings; the stage is unhomed afterwards. Raises DeviceError."""
        identity = self.link.connect(reset=self._reset_on_open == "expect")
        with closed_after_errors(self.link):
            for number, name in ((20, "soft limits"), (22, "homing")):
                if self.link.controls.flag(number) is False:
                    raise BadConfiguration(f"{name} are off at {self.address} (${number}=0)", "set $22=1, then $20=1")
            self._envelopes = {axis.name: self._envelope(axis) for axis in self._axes}
            self._user(self.link.report())
        return identity

    def _envelope(self, axis: GrblAxis) -> GrblEnvelope:
        limits = envelope(axis, self.link.letters.index(axis.letter), self.link.controls)
        if limits is None:
            raise BadConfiguration(
                f"{self.address} does not report the travel of {axis.letter}", "set travel or space for the axis"
            )
        if limits.travel.low >= limits.travel.high:
            raise BadConfiguration(
                f"{axis.name} has no travel between its switches at {self.address}",
                "set a smaller $27, or the true $130",
            )
        return limits

    @property
    def envelopes(self) -> Mapping[str, GrblEnvelope]:
        """The controller's limits of each axis; known after `connect`."""
        return dict(self._envelopes)

    def close(self) -> None:
        self.link.close()

    def travel(self) -> Mapping[str, Travel]:
        return {name: one.travel for name, one in self._envelopes.items()}

    def condition(self) -> Condition:
        """Its state in the last report."""
        if not self.link.is_open:
            return Condition("not connected", False, "connect it")
        if (why := self.link.trust.why) is not None:
            return Condition(why.reason, False, why.remedy, self._caveat())
        pause = PAUSES.get((self.link.last_state, self.link.last_sub))
        word = ": ".join(pause) if pause else self.link.last_state.lower()
        state_in_words = word if self.link.feed_override == 100.0 else f"{word}, {self._override_in_words()}"
        return Condition(state_in_words, caveat=self._caveat())

    def _override_in_words(self) -> str:
        return f"the feed override is {self.link.feed_override:.0f} %"

    def _caveat(self) -> Caveat | None:
        """Motors that are released between moves: a sagging or pushed axis is not detected."""
        delay_ms = self.link.setting(1, MOTORS_HELD)
        if delay_ms == MOTORS_HELD:
            return None
        reason = f"the motors let go {delay_ms:.0f} ms after each move, and an axis that hangs or is touched shifts"
        return Caveat(f"{reason} ($1={delay_ms:.0f})", "set $1=255, which keeps them on")

    def position(self) -> Mapping[str, float]:
        return self._user(self.link.settled_report())

    def _user(self, report: StatusReport) -> dict[str, float]:
        there = {}
        for name, one in self._envelopes.items():
            if one.index >= len(report.machine):
                reason = f"{self.address} reports {len(report.machine)} axes, none for {one.axis.letter}"
                raise BadConfiguration(reason, "correct the axis' letter")
            there[name] = one.to_user(report.machine[one.index])
        return there

    def moving(self) -> bool:
        return not self.link.report().still

    def home(self, allowed: Callable[[], None] = anything) -> None:
        with self._one_mover:
            epoch = self.link.recover()
            self._homing = True
            try:
                with self.power():
                    self._find_switches(in_turn(allowed, partial(self.link.trust.undisturbed, epoch)))
            finally:
                self._homing = False
            # raises BadConfiguration if the axes, after homing, are outside the assumed machine space
            machine = self.link.settled_report().machine
            for name, one in self._envelopes.items():
                if not one.homed_inside(machine[one.index]):
                    raise BadConfiguration(
                        f"{name} stands at machine position {machine[one.index]:g} after homing, outside the machine "
                        f"space {one.low:g} .. {one.high:g}",
                        "set `space` of the axis to its ends in machine coordinates",
                    )
            self.link.trust.give(epoch)

    def _find_switches(self, allowed: Callable[[], None]) -> None:
        """Home. Reset the controller if homing ends without its answer, as it would continue searching."""
        with left_still(self.link.confirm_reset, self.emergency_stop, self.link.trust):
            try:
                self.link.command("$H", self._homing_limit_s(), allowed)
            except (Rejected, WasReset, EmergencyStopped):
                raise
            except DeviceError as error:
                self.link.halt(NotHomed(f"homing was given up: {error.reason}", HOME))
                raise

    def _homing_limit_s(self) -> float:
        """Time limit of homing: the firmware homes all its axes, including those not configured here ($130 and up)."""
        controls = self.link.controls
        lengths = {one.index: one.high - one.low for one in self._envelopes.values()}
        lengths |= {i: length for i in range(len(self.link.letters)) if (length := controls.positive(130 + i, None))}
        return controls.homing_limit_s(lengths)

    def move_to(self, **target: float) -> None:
        """Move in a straight line and return when still. Raises DeviceError."""
        with self._one_mover as stops:
            self.link.require_trust()
            check_target(target, self.travel())
            goal = dict(target)
            report = self.link.settled_report()
            self._check_pause(report)
            start = self._user(report)
            feed, duration_s = self.pace({name: goal[name] - start[name] for name in goal})
            if duration_s == 0.0:
                return
            ways = [(self._envelopes[name], value) for name, value in goal.items()]
            words = " ".join(f"{one.axis.letter}{one.to_machine(value):.3f}" for one, value in ways)
            may_begin = self._one_mover.unless_stopped(stops, self.link.trust.require)
            self.link.last_message = ""
            with self.power(), left_still(self._give_up_moving, self.emergency_stop, self.link.trust):
                self.link.command(f"$J=G53 G90 G21 {words} F{feed:.1f}", allowed=may_begin)
                report = self._until_still(duration_s, stops)
                self._arrived(goal, self._user(report), stops)

    def pace(self, way: Mapping[str, float]) -> tuple[float, float]:
        """Feed along the line at which no axis exceeds its limit or the controller's, and the duration in seconds."""
        length = math.hypot(*way.values())
        parts = [(self._envelopes[name], abs(part)) for name, part in way.items()]
        moved = [(one, part / length) for one, part in parts if part > one.resolution / 2]
        if not moved:
            return 0.0, 0.0
        feed = min(min(one.axis.feed_per_min, one.rate_per_min) / share for one, share in moved)
        acceleration = min(one.acceleration_per_s2 / share for one, share in moved)
        top = min(feed / 60, math.sqrt(length * acceleration))  # a short move ends before it reaches its feed
        return feed, length / top + top / acceleration

    def _until_still(self, duration_s: float, stops: int) -> StatusReport:
        """Wait for two equal reports of Idle in a row, from the expected end of the move or a stop on.

        Raises NoAnswer after twice the duration plus two seconds.
        """
        limit_s = 2 * duration_s * 100 / min(self.link.feed_override, 100.0) + 2
        deadline_s = self.clock.now_s() + limit_s
        before = None
        self.link.pause(duration_s, partial(self._one_mover.stopped, stops))
        while True:
            report = self.link.report()
            stands, before = report == before, report
            if report.state == "Idle" and stands:
                return report
            self._check_pause(report)
            if report.state in ("Alarm", "Sleep"):
                raise MoveFailed(f"{self.address} stopped in state {report.state}", f"clear it, then {HOME}")
            if stands and self.link.last_message == DOOR_MESSAGE:
                raise self._at_the_door()
            if self.clock.now_s() > deadline_s:
                raise self._too_slow(limit_s)
            self.link.pause(0.0 if report.state == "Idle" else self._poll_s)

    def _check_pause(self, report: StatusReport) -> None:
        if report.pause is not None:
            reason, remedy = report.pause
            raise Held(f"{self.address} {reason}", remedy)

    def _at_the_door(self) -> Held:
        """The error for a door that the reports omit: such a jog resumes as a program, or is ended by a reset."""
        return Held(f"{self.address} was paused at the door in mid-move and reset", f"close it, then {HOME}")

    def _too_slow(self, limit_s: float) -> NoAnswer:
        late = f"{self.address} still moves after {limit_s:.1f} s"
        if self.link.feed_override < 100.0:
            return NoAnswer(f"{late}: {self._override_in_words()}", "set the override to 100 %")
        return NoAnswer(late, "check feed and mechanics")

    def _arrived(self, goal: Mapping[str, float], there: Mapping[str, float], stops: int) -> None:
        for name, target in goal.items():
            tolerance = 1.5 * self._envelopes[name].resolution
            check_arrival(name, target, there[name], tolerance, self._one_mover.stopped(stops))

    def _give_up_moving(self) -> None:
        """Stop the motion after an error, by a reset if the position is lost anyway. Raises DeviceError."""
        try:
            if self.link.trust.why is None:
                self._cancel_jog()
        except DeviceError as error:
            self.link.halt(error)
        self.link.confirm_reset()

    def _cancel_jog(self) -> None:
        for _ in range(20):
            self.link.write(JOG_CANCEL)
            if self.link.report().still:
                return
            self.link.pause(self._poll_s)
        if self.link.last_message == DOOR_MESSAGE:
            raise self._at_the_door()
        raise NoAnswer(f"{self.address} does not stop", "press the emergency stop at the bench")

    def stop(self) -> None:
        """Decelerate and stay; reset while homing, and if the position is lost anyway. Raises DeviceError."""
        self._one_mover.stop()
        if self._homing or self.link.trust.why is not None:
            self.link.halt(NotHomed("homing was stopped", HOME))
            return
        try:
            self._cancel_jog()
        except (NoAnswer, Held) as error:
            self.link.halt(error)
            raise

    def resume(self) -> None:
        """Continue after a feed hold, or after the door was closed. Raises Held, DeviceError."""
        report = self.link.report()
        if report.pause is not None and (report.state, report.sub) in RESUMABLE:
            self.link.write(RESUME)
            deadline_s = self.clock.now_s() + RESUME_S
            while (report := self.link.report()).pause is not None and self.clock.now_s() < deadline_s:
                self.link.pause(self._poll_s)
        self._check_pause(report)

    def lose_position(self, error: DeviceError) -> None:
        """Stop, and refuse to move with `error` until homed; never raises."""
        self._one_mover.stop()
        self.link.halt(error)

    def emergency_stop(self) -> None:
        """Feed hold and soft reset without waiting for any lock; unsafe until homed."""
        self._one_mover.stop()
        self.link.preempt(
            HOLD + RESET, EmergencyStopped(f"emergency stop at {self.address}", "make it safe, then home")
        )


@dataclass(frozen=True, kw_only=True)
class GrblOptions(LineOptions):
    """Options of driver "grbl"."""

    provides: ClassVar[tuple[str, ...]] = (GRBL_STAGE, ENABLED_STAGE)
    axes: Annotated[tuple[GrblAxis, ...], axes("letter")]
    poll_s: PollInterval = 0.2
    reset_on_open: Literal["expect", "avoid"] = "expect"

    def make(self, parts: MakerContext) -> GrblStage:
        dtr = False if self.reset_on_open == "avoid" else None
        wire = parts.wire(self.port, GrblParser, baud=self.baud, dtr=dtr)
        return GrblStage(wire, self.axes, clock=parts.clock, reset_on_open=self.reset_on_open, poll_s=self.poll_s)
