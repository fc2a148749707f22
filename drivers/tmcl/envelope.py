"""Settings of a module: the speed of an axis, and caveats about its position."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from drivers.errors import BadConfiguration, Rejected
from drivers.interfaces import Caveat

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
