"""Axes of TMCL modules as one Stage: microsteps in, millimetres or degrees out.

A module homes by its own reference search, and none of its stored settings is changed. It does not report a power
cycle, after which its position is 0 wherever it is. Homing therefore writes a number into a volatile variable of the
module, and no position is trusted without that number.
"""

import math
import secrets
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, cast

from drivers.errors import BadConfiguration, MoveFailed, Rejected, WasReset
from drivers.interfaces import Caveat, Condition, Identity, Transport, Travel
from drivers.making import LineOptions
from drivers.move_checks import HOME
from drivers.options import ENABLED_STAGE, AxisName, Baud, PollInterval, TimeLimit, axes, interval, option, positive
from drivers.polled_stage import AxisStage, AxisState
from drivers.tmcl.link import VERSION, VERSION_BINARY, TmclLink, TmclParser, stop_bytes
from drivers.wire.connection import anything, roll_call

START, STATUS = 0, 2  # phases of a reference search
VARIABLES = 2  # the bank of a module's user variables
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

    @property
    def tolerance(self) -> float:
        return PRECISION_STEPS * self.unit_per_step

    def to_steps(self, value: float) -> int:
        return round((value - self.zero) / (self.direction * self.unit_per_step))

    def to_unit(self, steps: float) -> float:
        return self.zero + steps * self.direction * self.unit_per_step


class TmclStage(AxisStage[bytes, TmclAxis]):
    """A Stage of TMCL modules on one line. `variable` is the number of the user variable that is written."""

    stop_bytes = b""

    def __init__(
        self, transport: Transport[bytes], axes: Sequence[TmclAxis], *, patience_s: float = 60.0, variable: int = 55,
        **more: Any,
    ) -> None:  # fmt: skip
        self._modules = tuple(dict.fromkeys(axis.module for axis in axes))
        self._link = TmclLink(transport, self._modules)
        super().__init__(cast(Transport[bytes], self._link), axes, **more)
        self.envelopes: dict[str, TmclEnvelope] = {}
        self._patience_s, self._variable = patience_s, variable
        self._seals: dict[int, int] = {}

    def connect(self) -> Identity:
        """Open, identify every module, read its settings. Raises DeviceError naming all missing modules."""
        self._seals.clear()
        self.stop_bytes = stop_bytes((axis.module, axis.motor) for axis in self._axes)
        return super().connect()

    def _introduce(self) -> tuple[str, str, str]:
        where = f"{self.address}: no answer from modules"
        remedy = "check power, cables, baud rate (9600 as delivered, 115200 over USB) and addresses"
        versions = [
            int(answer.value)
            for answer in roll_call(
                self._modules, lambda one: self._host().send(VERSION, VERSION_BINARY, 0, 0, one), where, remedy
            )
        ]
        models = dict.fromkeys(f"TMCM-{version >> 16}" for version in versions)
        firmware = dict.fromkeys(f"{version >> 8 & 0xFF}.{version & 0xFF:02}" for version in versions)
        return f"TMCL {'; '.join(models)}", "; ".join(firmware), ""

    def _host(self, allowed: Callable[[], None] = anything, tries: int = TRIES) -> Any:
        return self._link.host(allowed, tries)

    def _prepare(self, axis: TmclAxis) -> tuple[Travel, float]:
        # the parameters of an envelope; `host` raises Rejected for those that the module does not have
        host = self._host()
        numbers = (MAX_SPEED, MAX_ACCELERATION, STANDBY, RIGHT_OFF, LEFT_OFF, RAMP_DIVISOR, PULSE_DIVISOR)
        parameters = {number: _one(host, number, axis.module, axis.motor) for number in numbers}
        speed, rise = float(parameters[MAX_SPEED] or 0), float(parameters[MAX_ACCELERATION] or 0)
        pulses, ramps = parameters[PULSE_DIVISOR], parameters[RAMP_DIVISOR]
        if pulses is not None and ramps is not None:
            speed *= CLOCK_HZ / 2 ** (pulses + 16)
            rise *= CLOCK_HZ**2 / 2 ** (pulses + ramps + 29)
        if not speed > 0 or not rise > 0:
            raise BadConfiguration(
                f"{axis.name} is set to no speed or no acceleration", "set parameters 4 and 5 of its motor"
            )
        envelope = TmclEnvelope(speed, rise, parameters[STANDBY], bool(parameters[RIGHT_OFF] or parameters[LEFT_OFF]))
        self.envelopes[axis.name] = envelope
        return Travel(*axis.travel), envelope.speed * axis.unit_per_step

    def condition(self) -> Condition:
        return self.trust.refusal(self._link.is_open) or Condition("idle", caveat=self._caveat())

    def _caveat(self) -> Caveat | None:
        unsealed = [str(module) for module in self._modules if module not in self._seals]
        if unsealed:
            reason = f"module {', '.join(unsealed)} does not report that it was switched off"
            return Caveat(reason, "home after its power was cut")
        return next((c for name, envelope in self.envelopes.items() if (c := envelope.caveat(name))), None)

    def travel_s(self, name: str, way: float) -> float:
        """Duration of a move of this length, in the axis' unit; known after `connect`."""
        return next(self._duration_s(axis, way) for axis in self._axes if axis.name == name)

    def _duration_s(self, axis: TmclAxis, way: float) -> float:
        return self.envelopes[axis.name].travel_s(way / axis.unit_per_step)

    def settings(self) -> Mapping[str, str]:
        """The modules' settings as text, by axis; known after `connect`."""
        return {axis.name: self.envelopes[axis.name].words(axis.unit_per_step) for axis in self._axes}

    # --- state

    def _parameter(self, axis: TmclAxis, number: int) -> int:
        return int(self._host().get_axis_parameter(number, axis.motor, axis.module, signed=True))

    def _reading(self, axis: TmclAxis) -> float:
        """Its position. Raises WasReset if a homed module was switched off since."""
        here = axis.to_unit(self._parameter(axis, POSITION))
        if self.trust.why is None:
            self._check_seals()
        return here

    def _state(self, axis: TmclAxis) -> AxisState:
        here = axis.to_unit(self._parameter(axis, POSITION))
        searches = self._host().reference_search(STATUS, axis.motor, axis.module)
        return AxisState(here, bool(self._parameter(axis, SPEED) or searches))

    def _checked(self, axis: TmclAxis) -> AxisState:
        """The axis' state. Raises WasReset if a module was switched off since its homing began."""
        state = self._state(axis)
        self._check_seals()
        return state

    # --- power-cycle detection

    def _check_seals(self) -> None:
        """Raises WasReset if a module has lost its number: its position is meaningless."""
        for module, number in self._seals.items():
            if self._host().get_global_parameter(self._variable, VARIABLES, module) != number:
                error = WasReset(f"module {module} at {self.address} was switched off and on, or reset", HOME)
                self.trust.lose(error)
                raise error

    # --- moving

    def _begin_homing(self, axis: TmclAxis, allowed: Callable[[], None]) -> None:
        if axis is self._axes[0]:
            # write a number into every module, which a power cycle clears together with its position
            self._seals.clear()
            for module in self._modules:
                number = 1 + secrets.randbelow(2**31 - 1)
                try:
                    self._host(allowed).set_global_parameter(self._variable, VARIABLES, number, module)
                except Rejected:  # it does not have this variable
                    continue
                self._seals[module] = number
        self._host(allowed, 1).reference_search(START, axis.motor, axis.module)

    def _homing_limit_s(self) -> float:
        return self._patience_s

    def _check_homed(self, states: Mapping[TmclAxis, AxisState]) -> None:
        for axis, state in states.items():
            low, high = axis.travel
            if not low - axis.tolerance <= state.position <= high + axis.tolerance:
                raise MoveFailed(
                    f"{axis.name} is at {state.position:.4f} after homing, outside its travel {low:g} .. {high:g}",
                    "correct zero, direction or travel in station.toml",
                )

    def _begin_move(self, axis: TmclAxis, value: float, allowed: Callable[[], None]) -> None:
        self._check_seals()
        self._host(allowed, 1).move_to(axis.motor, axis.to_steps(value), axis.module)


@dataclass(frozen=True, kw_only=True)
class TmclOptions(LineOptions):
    """Options of driver "tmcl_stage"."""

    makes = TmclStage
    parser = TmclParser
    provides: ClassVar[tuple[str, ...]] = (ENABLED_STAGE,)
    axes: Annotated[tuple[TmclAxis, ...], axes("module", "motor")]
    baud: Baud = 9600
    poll_s: PollInterval = 0.1
    patience_s: TimeLimit = 60.0
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


def _one(host: Any, number: int, module: int, motor: int) -> int | None:
    try:
        return int(host.get_axis_parameter(number, motor, module, signed=True))
    except Rejected:
        return None
