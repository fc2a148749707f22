"""Axes of TMCL modules as one Stage: microsteps in, millimetres or degrees out.

A module homes by its own reference search, and none of its stored settings is changed. It does not report a power
cycle, after which its position is 0 wherever it is. Homing therefore writes a number into a volatile variable of the
module, and no position is trusted without that number.
"""

import math
import secrets
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, ClassVar, Literal

from drivers.errors import (
    BadConfiguration,
    Clock,
    DeviceError,
    EmergencyStopped,
    MoveFailed,
    NoAnswer,
    Rejected,
    SystemClock,
    WasReset,
)
from drivers.interfaces import Caveat, Condition, Identity, Transport, Travel
from drivers.making import LineOptions
from drivers.move_checks import HOME, UNHOMED, OneMover, Trust, check_arrival, check_target, left_still
from drivers.options import ENABLED_STAGE, AxisName, Baud, Patience, PollInterval, axes, interval, option, positive
from drivers.tmcl.link import VERSION, VERSION_BINARY, TmclLink, TmclParser, stop_bytes
from drivers.wire.connection import anything, not_connected, roll_call

START, STOP, STATUS = 0, 1, 2
"""Phases of a reference search."""
VARIABLES = 2
"""The bank of a module's user variables."""
PRECISION_STEPS = 2
TRIES = 3


@dataclass(frozen=True)
class TmclAxis:
    """One axis: its name with the unit, its motor and module, its travel in the unit, units per microstep.

    zero : the value at the reference, where the search sets 0
    direction : -1 if microsteps count in the opposite direction
    """

    name: AxisName
    motor: Annotated[int, option("0", least=0, most=15)]
    travel: Annotated[tuple[float, float], interval("[0.0, 300.0]")]
    unit_per_step: Annotated[float, positive("0.003125")]
    module: Annotated[int, option("1", least=1, most=255)] = 1
    zero: Annotated[float, option("0.0")] = 0.0
    direction: Literal[1, -1] = 1

    def to_steps(self, value: float) -> int:
        return round((value - self.zero) / (self.direction * self.unit_per_step))

    def to_unit(self, steps: float) -> float:
        return self.zero + steps * self.direction * self.unit_per_step


class TmclStage:
    """A Stage of TMCL modules on one line. `variable` is the number of the user variable that is written."""

    def __init__(
        self,
        transport: Transport[bytes],
        axes: Sequence[TmclAxis],
        *,
        clock: Clock | None = None,
        poll_s: float = 0.1,
        patience_s: float = 60.0,
        variable: int = 55,
    ) -> None:
        self.clock = clock or SystemClock()
        self.trust = Trust()
        self.envelopes: dict[str, TmclEnvelope] = {}
        self._axes = tuple(axes)
        self._named = {axis.name: axis for axis in axes}
        self._poll_s, self._patience_s, self._variable = poll_s, patience_s, variable
        self._modules = tuple(dict.fromkeys(axis.module for axis in axes))
        self._link = TmclLink(transport, self._modules)
        self._one_mover = OneMover()
        self.power: Callable[[], AbstractContextManager[None]] = nullcontext
        """Context of a move: a watchdog keeps the motors enabled within."""
        self._seals: dict[int, int] = {}
        self._stops = b""

    @property
    def address(self) -> str:
        return self._link.address

    def connect(self) -> Identity:
        """Open, identify every module, read its settings. Raises DeviceError naming all missing modules."""
        self._link.close()
        self.trust.lose(UNHOMED)
        self._seals.clear()
        self._stops = stop_bytes((axis.module, axis.motor) for axis in self._axes)
        self._link.open()
        try:
            identities = self._roll_call()
            self.envelopes = {axis.name: self._envelope(axis) for axis in self._axes}
        except DeviceError:
            self._link.close()
            raise
        self.trust.why = UNHOMED
        models, versions = ("; ".join(dict.fromkeys(column)) for column in zip(*identities, strict=True))
        return Identity(f"TMCL {models}", versions, "", self.address)

    def _roll_call(self) -> list[tuple[str, str]]:
        where = f"{self.address}: no answer from modules"
        remedy = "check power, cables, baud rate (9600 as delivered, 115200 over USB) and addresses"
        return roll_call(self._modules, self._introduce, where, remedy)

    def _introduce(self, module: int) -> tuple[str, str]:
        """Model and version."""
        version = int(self._link.host(tries=TRIES).send(VERSION, VERSION_BINARY, 0, 0, module).value)
        return f"TMCM-{version >> 16}", f"{version >> 8 & 0xFF}.{version & 0xFF:02}"

    def _envelope(self, axis: TmclAxis) -> "TmclEnvelope":
        return read_envelope(axis.name, ask_parameters(self._link.host(tries=TRIES), axis.module, axis.motor))

    def close(self) -> None:
        """Release the line; the position is not trusted afterwards."""
        self.trust.lose(UNHOMED)
        self._link.close()

    def condition(self) -> Condition:
        return self.trust.refusal(self._link.is_open) or Condition("idle", caveat=self._caveat())

    def _caveat(self) -> Caveat | None:
        unsealed = [str(module) for module in self._modules if module not in self._seals]
        if unsealed:
            reason = f"module {', '.join(unsealed)} does not report that it was switched off"
            return Caveat(reason, "home after its power was cut")
        return next((c for name, one in self.envelopes.items() if (c := one.caveat(name))), None)

    def _require_line(self) -> None:
        if not self._link.is_open:
            raise not_connected(self.address)

    # --- position

    def travel(self) -> Mapping[str, Travel]:
        """The configured range of each axis; known after `connect`."""
        return {axis.name: Travel(*axis.travel) for axis in self._axes if axis.name in self.envelopes}

    def travel_s(self, name: str, way: float) -> float:
        """Duration of a move of this length, in the axis' unit; known after `connect`."""
        return self.envelopes[name].travel_s(way / self._named[name].unit_per_step)

    def settings(self) -> Mapping[str, str]:
        """The modules' settings as text, by axis; known after `connect`."""
        return {name: one.words(self._named[name].unit_per_step) for name, one in self.envelopes.items()}

    def position(self) -> Mapping[str, float]:
        """Where the axes are now. Raises DeviceError, WasReset if a homed module was switched off since."""
        there = {axis.name: axis.to_unit(self._parameter(axis, POSITION)) for axis in self._axes}
        if self.trust.why is None:
            self._check_seals()
        return there

    def moving(self) -> bool:
        return any(self._parameter(axis, SPEED) or self._searching(axis) for axis in self._axes)

    def _parameter(self, axis: TmclAxis, number: int) -> int:
        return int(self._link.host(tries=TRIES).get_axis_parameter(number, axis.motor, axis.module, signed=True))

    def _searching(self, axis: TmclAxis) -> bool:
        return bool(self._search(axis, STATUS, tries=TRIES))

    def _search(
        self, axis: TmclAxis, what: int, allowed: Callable[[], None] = anything, tries: int = 1
    ) -> int:  # fmt: skip
        return int(self._link.host(allowed, tries).reference_search(what, axis.motor, axis.module))

    # --- power-cycle detection

    def _seal(self, allowed: Callable[[], None]) -> None:
        """Write a number into every module, which a power cycle clears together with its position."""
        self._seals.clear()
        for module in self._modules:
            number = 1 + secrets.randbelow(2**31 - 1)
            try:
                self._link.host(allowed, TRIES).set_global_parameter(self._variable, VARIABLES, number, module)
            except Rejected:  # it does not have this variable
                continue
            self._seals[module] = number

    def _check_seals(self) -> None:
        """Raises WasReset if a module has lost its number: its position is meaningless."""
        for module, number in self._seals.items():
            if self._link.host(tries=TRIES).get_global_parameter(self._variable, VARIABLES, module) != number:
                error = WasReset(f"module {module} at {self.address} was switched off and on, or reset", HOME)
                self.trust.lose(error)
                raise error

    # --- moving

    def home(self, allowed: Callable[[], None] = anything) -> None:
        """Run the reference search configured in every module. Raises DeviceError."""
        with self._one_mover as stops:
            self._require_line()
            epoch = self.trust.begin(self.trust.preemptions)
            undisturbed = self._one_mover.unless_stopped(stops, allowed, partial(self.trust.undisturbed, epoch))
            with self.power(), self._left_still(self._axes):
                self._seal(undisturbed)
                for axis in self._axes:
                    self._search(axis, START, undisturbed)
                self._wait_for_searches()
                if self._one_mover.stopped(stops):
                    raise MoveFailed(f"homing at {self.address} was stopped", HOME)
                self._check_inside()
            self.trust.give(epoch)

    def _wait_for_searches(self) -> None:
        deadline_s, epoch = self.clock.now_s() + self._patience_s, self.trust.epoch
        while any(self._searching(axis) for axis in self._axes):
            self._require_in_time(deadline_s, f"{self.address} still homes after {self._patience_s:g} s")
            self._pause(epoch)
            self._check_seals()
        self._check_seals()

    def _require_in_time(self, deadline_s: float, reason: str) -> None:
        if self.clock.now_s() > deadline_s:
            raise NoAnswer(reason, "check its mechanics, switches and speeds, or raise patience_s")

    def _check_inside(self) -> None:
        for axis in self._axes:
            here, (low, high), tolerance = self.position()[axis.name], axis.travel, _tolerance(axis)
            if not low - tolerance <= here <= high + tolerance:
                raise MoveFailed(
                    f"{axis.name} is at {here:.4f} after homing, outside its travel {low:g} .. {high:g}",
                    "correct zero, direction or travel in station.toml",
                )

    def move_to(self, **target: float) -> None:
        """Move the axes independently, and return when all are still. Raises DeviceError."""
        with self._one_mover as stops:
            self._require_line()
            self.trust.require()
            check_target(target, self.travel())
            goals = {axis: axis.to_steps(target[axis.name]) for axis in self._axes if axis.name in target}
            longest_s = max((self._travel_s(axis, goal) for axis, goal in goals.items()), default=0.0)
            may_go = self._one_mover.unless_stopped(stops, self.trust.require)
            with self.power(), self._left_still(goals):
                for axis, goal in goals.items():
                    self._check_seals()
                    self._link.host(may_go).move_to(axis.motor, goal, axis.module)
                self._wait_for_rest(goals, 2 * longest_s + 2)
                there, stopped = self.position(), self._one_mover.stopped(stops)
                for axis in goals:
                    check_arrival(axis.name, target[axis.name], there[axis.name], _tolerance(axis), stopped)

    def _travel_s(self, axis: TmclAxis, goal: int) -> float:
        return self.envelopes[axis.name].travel_s(abs(goal - self._parameter(axis, POSITION)))

    def _wait_for_rest(self, goals: Mapping[TmclAxis, int], limit_s: float) -> None:
        """Wait until every axis is at its goal, or twice at the same position. Raises NoAnswer after the limit."""
        deadline_s, epoch = self.clock.now_s() + limit_s, self.trust.epoch
        before: dict[TmclAxis, int] = {}
        while True:
            self._check_seals()
            here = {axis: self._parameter(axis, POSITION) for axis in goals}
            on_its_way = [
                axis
                for axis, goal in goals.items()
                if self._parameter(axis, SPEED) or here[axis] not in (goal, before.get(axis))
            ]
            if not on_its_way:
                return
            self._require_in_time(deadline_s, f"{on_its_way[0].name} still moves after {limit_s:.1f} s")
            before = here
            self._pause(epoch)

    def _pause(self, epoch: int) -> None:
        """Wait until the next poll; an emergency stop ends it."""
        self._link.wait(lambda: self.trust.epoch != epoch, self._poll_s)
        self.trust.undisturbed(epoch)

    def _left_still(self, axes: Iterable[TmclAxis]) -> AbstractContextManager[None]:
        return left_still(partial(self._halt, tuple(axes)), self.emergency_stop, self.trust)

    def _halt(self, axes: Iterable[TmclAxis]) -> None:
        """End a search first: it would drive a stopped motor on."""
        for axis in axes:
            self._search(axis, STOP, tries=TRIES)
            self._link.host(tries=TRIES).stop(axis.motor, axis.module)

    def stop(self) -> None:
        """Decelerate and stay: sent at once without queueing, then confirmed. Raises DeviceError."""
        self._one_mover.stop()
        self._require_line()
        try:
            self._link.urge(self._stops)
        except NoAnswer:
            self.emergency_stop()
            raise
        self._halt(self._axes)

    def lose_position(self, error: DeviceError) -> None:
        """Stop, and refuse to move with `error` until homed; never raises."""
        self._one_mover.stop()
        self.trust.lose(error)
        self._link.preempt(self._stops, error)

    def emergency_stop(self) -> None:
        """Stop all motors without waiting for pending requests; unsafe until homed."""
        self._one_mover.stop()
        error = EmergencyStopped(f"emergency stop at {self.address}", f"make it safe, then {HOME}")
        self.trust.preempt(error)
        self._link.preempt(self._stops, error)


def _tolerance(axis: TmclAxis) -> float:
    return PRECISION_STEPS * axis.unit_per_step


@dataclass(frozen=True, kw_only=True)
class TmclOptions(LineOptions):
    """Options of driver "tmcl_stage"."""

    makes = TmclStage
    parser = TmclParser
    provides: ClassVar[tuple[str, ...]] = (ENABLED_STAGE,)
    axes: Annotated[tuple[TmclAxis, ...], axes("module", "motor")]
    baud: Baud = 9600
    poll_s: PollInterval = 0.1
    patience_s: Patience = 60.0
    variable: Annotated[int, option("55", least=0, most=255)] = 55


# --- Settings of a module: the speed of an axis, and caveats about its position ---

POSITION, SPEED = 1, 3
MAX_SPEED, MAX_ACCELERATION, STANDBY, RIGHT_OFF, LEFT_OFF, RAMP_DIVISOR, PULSE_DIVISOR = 4, 5, 7, 12, 13, 153, 154
"""Parameters of an axis, by number."""
CLOCK_HZ = 16e6


@dataclass(frozen=True)
class TmclEnvelope:
    """One axis: microsteps per second and per second squared, disabled switches, the current at rest."""

    speed: float
    acceleration: float
    standby: int | None
    switches_off: bool

    def travel_s(self, steps: float) -> float:
        """Duration of a move of this length, from rest to rest."""
        if steps * self.acceleration < self.speed**2:
            return 2 * math.sqrt(steps / self.acceleration)
        return steps / self.speed + self.speed / self.acceleration

    def words(self, unit_per_step: float) -> str:
        """Speed, acceleration and switches in the axis' unit, as text."""
        speed, rise = self.speed * unit_per_step, self.acceleration * unit_per_step
        switches = "an end switch off" if self.switches_off else "end switches on"
        return f"{speed:g} per s, {rise:g} per s^2, {switches}"

    def caveat(self, name: str) -> Caveat | None:
        """Why its position deserves less trust, if it does."""
        if self.standby == 0:
            return Caveat(f"{name} releases its motor between moves (parameter 7 is 0)", "set a standby current")
        if self.switches_off:
            remedy = "set parameters 12 and 13 to 0 where there are switches"
            return Caveat(f"an end switch does not stop {name} (parameters 12 and 13)", remedy)
        return None


def read_envelope(name: str, parameters: Mapping[int, int | None]) -> TmclEnvelope:
    """The limits given by the parameters of an axis, None for a number it does not have. Raises BadConfiguration.

    Modules with a TMC428 or TMC429 report speed and acceleration in units of their dividers (data sheet, "velocity
    and acceleration"); the others in microsteps per second.
    """
    speed, rise = float(parameters[MAX_SPEED] or 0), float(parameters[MAX_ACCELERATION] or 0)
    pulses, ramps = parameters[PULSE_DIVISOR], parameters[RAMP_DIVISOR]
    if pulses is not None and ramps is not None:
        speed *= CLOCK_HZ / 2 ** (pulses + 16)
        rise *= CLOCK_HZ**2 / 2 ** (pulses + ramps + 29)
    if not speed > 0 or not rise > 0:
        raise BadConfiguration(f"{name} is set to no speed or no acceleration", "set parameters 4 and 5 of its motor")
    return TmclEnvelope(speed, rise, parameters[STANDBY], bool(parameters[RIGHT_OFF] or parameters[LEFT_OFF]))


def ask_parameters(host: Any, module: int, motor: int) -> dict[int, int | None]:
    """The parameters of an envelope; `host` raises Rejected for those that the module does not have."""
    numbers = (MAX_SPEED, MAX_ACCELERATION, STANDBY, RIGHT_OFF, LEFT_OFF, RAMP_DIVISOR, PULSE_DIVISOR)
    return {number: _one(host, number, module, motor) for number in numbers}


def _one(host: Any, number: int, module: int, motor: int) -> int | None:
    try:
        return int(host.get_axis_parameter(number, motor, module, signed=True))
    except Rejected:
        return None
