"""A TMCL module at byte level; each of its motors moves one axis of the world.

Like modules with a TMC429 (TMCM-3110): speeds in units of dividers, a reference search that runs by itself and that
a stop of the motor does not end. It always reads nine bytes at a time: only an additional or missing byte
changes its framing. After power-up its position is 0.
Source: TMCM-3110 TMCL firmware manual.
"""

import struct
from collections.abc import Sequence
from typing import cast

from simulators.devices.serial_device import Motor, MotorController
from simulators.world.motion import Axis

HOST = 2
DATAGRAM = struct.Struct(">BBBBiB")
OK, DAMAGED, NO_COMMAND, NO_TYPE, NO_VALUE = 100, 1, 2, 3, 4
ROR, ROL, MST, MVP, SAP, GAP, SGP, RFS, VERSION = 1, 2, 3, 4, 5, 6, 9, 13, 136
CLOCK_HZ = 16e6
SETTINGS = {
    4: 1500, 5: 900, 6: 128, 7: 16, 12: 0, 13: 0, 140: 8, 153: 5, 154: 3, 193: 1, 194: 0, 195: 0,
}  # fmt: skip
"""Parameters by number: top speed and acceleration, currents, switches, microsteps, dividers, reference search."""
VARIABLES = 56


class TmclMotor(Motor):
    """One motor: units per microstep, its settings, and its goal in microsteps."""

    def __init__(self, axis: Axis, unit_per_step: float) -> None:
        super().__init__(axis)
        self.unit_per_step, self.settings, self.goal = unit_per_step, dict(SETTINGS), 0

    def steps(self, now_s: float) -> int:
        return round(self.position(now_s) / self.unit_per_step)

    def _speed_unit(self) -> float:
        if 154 not in self.settings:  # newer modules use microsteps
            return self.unit_per_step
        return CLOCK_HZ / 2.0 ** (self.settings[154] + 16) * self.unit_per_step

    def go(self, position: float, now_s: float) -> None:
        """Drive as its settings say; a switch at the end of the axis stops it at once."""
        self.speed = self.settings[4] * self._speed_unit()
        self.acceleration = self.settings[5] * self.unit_per_step
        if 153 in self.settings:
            self.acceleration *= CLOCK_HZ**2 / 2.0 ** (self.settings[153] + self.settings[154] + 29)
        super().go(position, now_s)

    def search(self, what: int, now_s: float) -> int:
        """Begin, end, or query the search for its left switch."""
        if what == 0:
            self.home(now_s)
        elif what == 1 and self.homing:
            self.stop(now_s)
        return int(self.homing)

    def restart(self, now_s: float) -> None:
        super().restart(now_s)
        self.goal = 0

    def advance(self, now_s: float) -> None:
        self.goal = 0 if self.homing and self.rest_s <= now_s else self.goal
        super().advance(now_s)

    def parameter(self, number: int, now_s: float) -> int | None:
        """Value of a parameter of the axis, None if it does not exist."""
        here = self.steps(now_s)
        known = {
            0: self.goal,
            1: here,
            2: self.settings[4] if self.moves() else 0,
            3: round(self.axis.velocity(now_s) / self._speed_unit()),
            8: int(here == self.goal),
            10: int(self.axis.position(now_s) >= self.axis.high),
            11: int(self.axis.position(now_s) <= self.axis.low),
        }
        return known.get(number, self.settings.get(number))


class TmclModule(MotorController[int]):
    """One module on a line, by its address."""

    baud = 9600

    def __init__(self, motors: Sequence[tuple[Axis, float]] = (), *, address: int = 1, model: int = 3110) -> None:
        motors = motors or [(Axis(0.0, 300.0, 120.0), 1 / 320)]
        super().__init__(dict(zip(("z_mm", "x_mm", "y_mm"), (axis for axis, _ in motors), strict=False)), ())
        self.motors: dict[int, Motor] = {number: TmclMotor(*motor) for number, motor in enumerate(motors)}
        self.address, self.model = address, model
        self.obeyed: list[tuple[int, int, int, int]] = []
        self.restart(0.0)

    def restart(self, now_s: float) -> None:
        """Power cycle: all motors stand, at position 0."""
        super().restart(now_s)
        self.variables = [0] * VARIABLES

    def receive(self, data: bytes, now_s: float) -> None:
        """Commands of nine bytes each."""
        for byte in data:
            self._received.append(byte)
            if len(self._received) == DATAGRAM.size:
                order = bytes(self._received)
                self._received.clear()
                self._receive_order(order, now_s)

    def _receive_order(self, order: bytes, now_s: float) -> None:
        address, command, kind, number, value, checksum = DATAGRAM.unpack(order)
        if address != self.address:
            return
        if sum(order[:-1]) & 0xFF != checksum:
            self._send(DAMAGED, command, value)
            return
        self.obeyed.append((command, kind, number, value))
        if command == VERSION and kind == 0:  # an answer of special form, without checksum
            self._out += bytes([HOST]) + b"%04dV115" % self.model
            return
        status, answer = self._obey(command, kind, number, value, now_s)
        self._send(status, command, answer)

    def _send(self, status: int, command: int, value: int) -> None:
        body = DATAGRAM.pack(HOST, self.address, status, command, value, 0)[:-1]
        self._out += body + bytes([sum(body) & 0xFF])

    def _obey(self, command: int, kind: int, number: int, value: int, now_s: float) -> tuple[int, int]:
        match command:
            case 136:
                return OK, self.model << 16 | 1 << 8 | 15
            case 9 | 10:
                return self._variable(command, kind, number, value)
        if command not in (ROR, ROL, MST, MVP, SAP, GAP, RFS):
            return NO_COMMAND, value
        if number >= len(self.motors):
            return NO_VALUE, value
        motor = cast(TmclMotor, self.motors[number])
        if command in (SAP, GAP):
            return _parameter(motor, command, kind, value, now_s)
        if command == RFS:
            return (OK, motor.search(kind, now_s)) if kind in (0, 1, 2) else (NO_TYPE, value)
        if command == MVP:
            if kind not in (0, 1):
                return NO_TYPE, value
            motor.goal = value if kind == 0 else motor.steps(now_s) + value
            motor.go(motor.goal * motor.unit_per_step, now_s)
            return OK, motor.goal
        if motor.homing:  # the search continues by itself
            return OK, value
        if command == MST:
            motor.stop(now_s)
        else:
            motor.go((motor.axis.high if command == ROR else motor.axis.low) - motor.place_of_zero, now_s)
        return OK, value

    def _variable(self, command: int, kind: int, bank: int, value: int) -> tuple[int, int]:
        if bank != 2 or kind >= len(self.variables):
            return NO_TYPE, value
        if command == SGP:
            self.variables[kind] = value
        return OK, self.variables[kind]


def _parameter(motor: TmclMotor, command: int, kind: int, value: int, now_s: float) -> tuple[int, int]:
    if command == SAP and kind == 1:
        motor.place_of_zero = motor.axis.position(now_s) - value * motor.unit_per_step
    elif command == SAP and kind in motor.settings:
        motor.settings[kind] = value
    result = motor.parameter(kind, now_s)
    return (NO_TYPE, value) if result is None else (OK, result)
