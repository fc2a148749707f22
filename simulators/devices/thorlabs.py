"""A Thorlabs controller with the APT protocol at byte level: a K-Cube, or a rack with a motor in each bay.

It reads six bytes at a time, and the data that such a header announces; an unknown header is dropped. Positions are
counts.
Source: Thorlabs, APT communications protocol, issue 29.
"""

import struct
from collections.abc import Mapping, Sequence
from itertools import count

from simulators.devices.serial_device import Motor, MotorController, drained
from simulators.world.motion import Axis

HOST, LONG, USB = 0x01, 0x80, 0x50
CYCLE_S = 2048 / 6e6
LENGTHS = {0x0413: 14, 0x0416: 22, 0x0440: 14, 0x0448: 6, 0x0450: 6, 0x0453: 6, 0x043A: 6}
"""Data of the messages that have some."""
SHORT = (
    0x0002, 0x0005, 0x0011, 0x0012, 0x0210, 0x0211, 0x0223, 0x0414, 0x0417, 0x0441, 0x043B, 0x0443, 0x0451, 0x0453,
    0x0465, 0x0480, 0x0490, 0x0492,
)  # fmt: skip


class AptTwin(MotorController[int]):
    """Motors by their bays; `number` of counts per unit of the axis."""

    baud = 115200

    def __init__(
        self, axes: Mapping[str, Axis] | None = None, *, counts: float = 34304.0, sources: Sequence[int] = ()
    ) -> None:
        two = {"x_mm": Axis(0.0, 50.0, 21.0), "y_mm": Axis(0.0, 25.0, 9.0)}
        super().__init__(axes or two, sources or count(0x21), 10.0)
        self._counts = counts
        self._targets = dict.fromkeys(self.motors, 0)
        self._reported = dict.fromkeys(self.motors, True)

    def restart(self, now_s: float) -> None:
        """Off and on again: not homed."""
        super().restart(now_s)
        self._targets = dict.fromkeys(self.motors, 0)
        self._reported = dict.fromkeys(self.motors, True)

    def receive(self, data: bytes, now_s: float) -> None:
        self._received += data
        while len(self._received) >= 6:
            number, length, dest, _ = struct.unpack_from("<HHBB", self._received)
            size = 6 + (length if dest & LONG else 0)
            known = LENGTHS.get(number) == length if dest & LONG else number in SHORT
            if not known:
                del self._received[:6]
                continue
            if len(self._received) < size:
                return
            message = bytes(self._received[:size])
            del self._received[:size]
            self._obey(number, dest & ~LONG, message, now_s)

    def _obey(self, number: int, dest: int, message: bytes, now_s: float) -> None:
        motor, data = self.motors.get(dest), message[6:]
        if motor is None:
            return
        match number:
            case 0x0005:
                info = struct.pack("<l8sH4B60sHHH", 27000000 + dest, b"KDC101\0\0", 16, 4, 2, 1, 0, b"", 1, 0, 1)
                self._send(0x0006, dest, info)
            case 0x0490:
                self._send(0x0491, dest, self._status(motor, now_s))
            case 0x0480:
                position, bits = self._counted(motor, now_s), self._bits(motor, now_s)
                self._send(0x0481, dest, struct.pack("<HllL", 1, position, position, bits))
            case 0x0414:
                unit = self._counts * 65536 * CYCLE_S
                values = round(motor.acceleration * unit * CYCLE_S), round(motor.speed * unit)
                self._send(0x0415, dest, struct.pack("<Hlll", 1, 0, *values))
            case 0x0413:
                motor.speed = struct.unpack("<Hlll", data)[3] / (self._counts * 65536 * CYCLE_S) or motor.speed
            case 0x0450:
                (self._targets[dest],) = struct.unpack_from("<l", data, 2)
            case 0x0451:
                self._send(0x0452, dest, struct.pack("<Hl", 1, self._targets[dest]))
            case 0x0443 | 0x0448 | 0x0453:
                self._drive(number, dest, data, now_s)
            case 0x0465:
                motor.stop(now_s)
                self._reported[dest] = False

    def _drive(self, number: int, dest: int, data: bytes, now_s: float) -> None:
        motor = self.motors[dest]
        self._reported[dest] = False
        if number == 0x0443:
            motor.home(now_s)
            return
        if data:
            (value,) = struct.unpack_from("<l", data, 2)
            self._targets[dest] = value + (self._counted(motor, now_s) if number == 0x0448 else 0)
        motor.go(self._targets[dest] / self._counts, now_s)

    def _counted(self, motor: Motor, now_s: float) -> int:
        return round(motor.position(now_s) * self._counts)

    def _bits(self, motor: Motor, now_s: float) -> int:
        forward = motor.axis.velocity(now_s) > 0
        moving = (0x10 if forward else 0x20) if motor.moves() else 0
        ends = (motor.axis.position(now_s) >= motor.axis.high) | (motor.axis.position(now_s) <= motor.axis.low) << 1
        return 0x80000100 | ends | moving | motor.homing << 9 | motor.referenced << 10

    def _status(self, motor: Motor, now_s: float) -> bytes:
        speed = round(abs(motor.axis.velocity(now_s)))
        return struct.pack("<HlHHL", 1, self._counted(motor, now_s), speed, 0, self._bits(motor, now_s))

    def _send(self, number: int, source: int, data: bytes) -> None:
        self._out += struct.pack("<HHBB", number, len(data), HOST | LONG, source) + data

    def advance(self, now_s: float) -> bytes:
        """Drives that have ended, each with its message, and the output."""
        ended = {place: motor.homing for place, motor in self.motors.items() if motor.rest_s <= now_s}
        output = super().advance(now_s)
        for place, homed in ended.items():
            if not self._reported[place]:
                self._reported[place] = True
                if homed:
                    self._out += struct.pack("<HBBBB", 0x0444, 1, 0, HOST, place)
                else:
                    self._send(0x0464, place, self._status(self.motors[place], now_s))
        return output + drained(self._out)
