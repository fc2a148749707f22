"""A bench instrument with SCPI at byte level: a lamp on a supply, a thermometer, hygrometer and power meter.

Source: SCPI-99, volumes 1 and 2.
"""

from collections import deque
from typing import Protocol

from simulators.devices.serial_device import SerialDevice, drained

IDENTITY = "STATION,SIM-SUPPLY,1001,1.02"
NOT_A_NUMBER = 9.91e37


class Surrounding(Protocol):
    """The room and the lamp: a World, for instance."""

    def temperature_c(self, t_s: float) -> float:
        """Temperature of the room."""

    def set_lamp(self, level: float, now_s: float) -> None:
        """Switch the lamp."""

    def lamp(self, t_s: float) -> float:
        """Light of the lamp."""


class ScpiTwin(SerialDevice):
    """A supply of `full` amperes for full light; `unplugged` sensors report that they have no number."""

    baud = 9600

    def __init__(self, world: Surrounding, *, full: float = 2.0, limit: float = 3.0) -> None:
        self.unplugged = False
        self._world, self._full, self._limit = world, full, limit
        self._current, self._on = 0.0, False
        self._errors: deque[str] = deque(maxlen=20)
        self._received, self._out = bytearray(), bytearray()

    def receive(self, data: bytes, now_s: float) -> None:
        """Lines; several commands are separated by semicolons."""
        for byte in data:
            if byte != ord("\n"):
                self._received.append(byte)
                continue
            line = self._received.decode("ascii", "replace").strip().upper()
            self._received.clear()
            replies = [reply for part in line.split(";") if part and (reply := self._obey(part.lstrip(":"), now_s))]
            if replies:
                self._out += ";".join(replies).encode() + b"\n"

    def _obey(self, command: str, now_s: float) -> str:
        """Execute one command; its reply, or nothing."""
        head, _, value = command.partition(" ")
        measured = {"MEAS:TEMP?": self._world.temperature_c(now_s), "MEAS:HUM?": 45.2, "MEAS:POW?": 1e-3}
        if head in measured:
            return f"{NOT_A_NUMBER if self.unplugged else measured[head]:+.6E}"
        match head:
            case "*IDN?":
                return IDENTITY
            case "SYST:ERR?":
                return self._errors.popleft() if self._errors else '0,"No error"'
            case "CURR?":
                return f"{self._current:.4f}"
            case "OUTP?":
                return str(int(self._on))
            case "MEAS:CURR?":
                return f"{self._current * self._on:.4f}"
            case "CURR":
                self._set_current(value, now_s)
            case "OUTP" if value in ("0", "1", "OFF", "ON"):
                self._on = value in ("1", "ON")
                self._light(now_s)
            case "*RST" | "*CLS":
                self._errors.clear()
            case _:
                self._errors.append('-113,"Undefined header"')
        return ""

    def _set_current(self, value: str, now_s: float) -> None:
        try:
            current = float(value)
        except ValueError:
            self._errors.append('-104,"Data type error"')
            return
        if not 0 <= current <= self._limit:
            self._errors.append('-222,"Data out of range"')
            return
        self._current = current
        self._light(now_s)

    def _light(self, now_s: float) -> None:
        self._world.set_lamp(min(self._current * self._on / self._full, 1.0), now_s)

    def advance(self, now_s: float) -> bytes:
        return drained(self._out)
