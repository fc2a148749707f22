"""Rangefinders and light panels at byte level."""

import struct
from collections import deque
from typing import Protocol

import numpy as np

from simulators.devices.serial_device import SerialDevice, drained
from simulators.world.world import World

NEVER = float("inf")
HOUSING_MM = 120.0  # from the laser's reference plane to the camera's principal plane
SENSE_S = {0: 0.4, 1: 1.2, 2: 0.15}  # auto, slow, fast


def jrt(head: int, register: int, payload: bytes) -> bytes:
    """A frame of the AA family."""
    body = struct.pack(">BHH", 0, register, len(payload) // 2) + payload
    return bytes((head,)) + body + bytes((sum(body) & 0xFF,))


class LaserTwin(SerialDevice):
    """A laser distance meter aimed at the chart; a `status` other than 0 makes every reading fail with it."""

    def __init__(self, world: World, rng: np.random.Generator, *, noise_mm: float) -> None:
        self.status = 0
        self.laser = False
        self._world, self._rng, self._noise_mm = world, rng, noise_mm
        self._inbox = b""
        self._out = bytearray()
        self._ready_s = NEVER

    def next_event_s(self) -> float | None:
        return None if self._ready_s == NEVER else self._ready_s


class JrtModule(LaserTwin):
    """A JRT/Meskernel module."""

    baud = 19200

    def __init__(self, world: World, rng: np.random.Generator) -> None:
        super().__init__(world, rng, noise_mm=0.6)
        self._mode = 0

    def receive(self, data: bytes, now_s: float) -> None:
        """Commands; `U` alone is answered by the address, `X` stops."""
        self._inbox = (self._inbox + data)[-64:]
        while self._inbox:
            length = self._command(now_s)
            if length == 0:
                return
            self._inbox = self._inbox[length:]

    def _command(self, now_s: float) -> int:
        """Execute the first command in the inbox; returns the bytes used, 0 while it is incomplete."""
        head = self._inbox[:1]
        if head == b"U":
            self._out += b"\0"
        elif head == b"X":
            self._ready_s = NEVER
        if head != b"\xaa":
            return 1
        if len(self._inbox) < 2:
            return 0
        length = 5 if self._inbox[1] & 0x80 else 9
        command = self._inbox[:length]
        if len(command) < length:
            return 0
        if sum(command[1:-1]) & 0xFF != command[-1]:
            return 1
        self._obey(command, now_s)
        return length

    def _obey(self, command: bytes, now_s: float) -> None:
        register = int.from_bytes(command[2:4], "big")
        if command[1] & 0x80:
            values = {0x0000: self.status, 0x0006: 0x3300, 0x000A: 0x0103}
            if register in values:
                self._out += jrt(0xAA, register, struct.pack(">H", values[register]))
        elif register == 0x0020 and command[7] in SENSE_S:
            self._ready_s, self._mode, self.laser = now_s + SENSE_S[command[7]], command[7], True
        elif register == 0x01BE:
            self.laser = bool(command[7])
            self._out += command

    def advance(self, now_s: float) -> bytes:
        if self._ready_s <= now_s:
            at_s, self._ready_s, self.laser = self._ready_s, NEVER, False
            self._out += self._reading(at_s)
        return drained(self._out)

    def _reading(self, at_s: float) -> bytes:
        if self.status and not (self.status == 8 and self._mode == 1):  # a weak echo is enough for the slow mode
            return jrt(0xEE, 0x0000, struct.pack(">H", self.status))
        noise_mm = self._noise_mm * (0.5 if self._mode == 1 else 1.0)
        measured = self._world.distance_mm(at_s) + HOUSING_MM + self._rng.normal(0, noise_mm)
        return jrt(0xAA, 0x0022, struct.pack(">IH", round(measured), int(self._rng.integers(40, 90))))


BOSCH_CRC = [0] * 256
for _i in range(256):
    _v = _i
    for _ in range(8):
        _v = ((_v << 1) ^ 0xA6) & 0xFF if _v & 0x80 else _v << 1
    BOSCH_CRC[_i] = _v


def bosch(body: bytes) -> bytes:
    """A message with its CRC."""
    value = 0xAA
    for byte in body:
        value = BOSCH_CRC[value ^ byte]
    return body + bytes((value,))


class BoschModule(LaserTwin):
    """A Bosch GLM."""

    baud = 115200

    def __init__(self, world: World, rng: np.random.Generator) -> None:
        super().__init__(world, rng, noise_mm=0.4)

    def receive(self, data: bytes, now_s: float) -> None:
        """`C0 command 00 CRC`."""
        self._inbox = (self._inbox + data)[-64:]
        while (at := self._inbox.find(b"\xc0")) >= 0 and len(self._inbox) >= at + 4:
            command = self._inbox[at : at + 4]
            if bosch(command[:3]) == command:
                self._inbox = self._inbox[at + 4 :]
                self._obey(command[1], now_s)
            else:
                self._inbox = self._inbox[at + 1 :]
                self._out += bosch(b"\x03\x00")

    def _obey(self, command: int, now_s: float) -> None:
        if command == 0x40:
            self._ready_s, self.laser = now_s + 0.25, True
        elif command in (0x41, 0x42):
            self.laser = command == 0x41
            self._out += bosch(b"\x00\x00")
        else:
            self._out += bosch(b"\x04\x00")

    def advance(self, now_s: float) -> bytes:
        if self._ready_s <= now_s:
            at_s, self._ready_s = self._ready_s, NEVER
            measured = self._world.distance_mm(at_s) + HOUSING_MM + self._rng.normal(0, self._noise_mm)
            good = b"\x00\x04" + struct.pack("<I", round(measured / 0.05))
            self._out += bosch(bytes((self.status, 0)) if self.status else good)
        return drained(self._out)


class DmxWidget(SerialDevice):
    """An Enttec DMX USB Pro with one lamp on a channel."""

    baud = 0

    def __init__(self, world: World, *, channel: int = 1) -> None:
        self.slots = bytes(512)
        self._world, self._channel = world, channel
        self._inbox = b""
        self._out = bytearray()

    def receive(self, data: bytes, now_s: float) -> None:
        """`7E label length data E7`."""
        self._inbox += data
        while (at := self._inbox.find(b"\x7e")) >= 0 and len(self._inbox) >= at + 4:
            label, length = struct.unpack_from("<BH", self._inbox, at + 1)
            end = at + 5 + length
            if length <= 600 and len(self._inbox) < end:
                return
            good = length <= 600 and self._inbox[end - 1] == 0xE7
            if good:
                self._obey(label, self._inbox[at + 4 : end - 1], now_s)
            self._inbox = self._inbox[end if good else at + 1 :]

    def _obey(self, label: int, data: bytes, now_s: float) -> None:
        if label == 6 and data[:1] == b"\0" and len(data) >= 25:
            self.slots = data[1:]
            if self._channel <= len(self.slots):
                self._world.set_lamp(self.slots[self._channel - 1] / 255, now_s)
        elif label == 3:
            self._send(3, bytes((4, 1, 9, 1, 40)))
        elif label == 10:
            self._send(10, bytes.fromhex("78563412"))

    def _send(self, label: int, data: bytes) -> None:
        self._out += b"\x7e" + struct.pack("<BH", label, len(data)) + data + b"\xe7"

    def advance(self, now_s: float) -> bytes:
        return drained(self._out)


# --- A bench instrument with SCPI at byte level: a lamp on a supply, a thermometer, hygrometer and power meter ---
# Source: SCPI-99, volumes 1 and 2.

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
