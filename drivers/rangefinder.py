"""Laser distance meters: JRT/Meskernel modules (AA frames) and Bosch GLM over a serial Bluetooth port.

JRT: `AA addr regHi regLo cntHi cntLo payload CS`, count in 16-bit words, CS the low byte of the sum after AA; a frame
that begins with EE carries a status instead. Bosch: `status length payload CRC8`, CRC start 0xAA, polynomial 0xA6.
"""

from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import ClassVar, TypeVar

from drivers.errors import DeviceError, EmergencyStopped, NoAnswer, NoReading
from drivers.interfaces import Distance, Identity, Transport
from drivers.making import LineOptions
from drivers.options import Baud
from drivers.protocols.framing import BAD, MORE, Decoder, FrameSplitter, numbered
from drivers.wire.connection import LineDevice, opened

E = TypeVar("E")
RESULT, LASER, STATUS, VERSION = 0x0022, 0x01BE, 0x0000, 0x000A
MEASURE_AUTO, MEASURE_SLOW = bytes.fromhex("AA0000200001000021"), bytes.fromhex("AA0000200001000122")
STOP, WAKE = b"X", b"\x55"
MOST_WORDS = 4
REPLY_S, AUTO_S, SLOW_S = 1.0, 5.0, 8.0
STATUSES = numbered("jrt status")
BOSCH_STATUSES = numbered("bosch status")


@dataclass(frozen=True)
class JrtFrame:
    """One valid frame: whether it is an error frame, its register and payload."""

    error: bool
    register: int
    payload: bytes


def _measure_jrt(head: bytes) -> int:
    if len(head) < 6:
        return MORE
    words = int.from_bytes(head[4:6], "big")
    length = 7 + 2 * words
    if not 1 <= words <= MOST_WORDS:
        return BAD
    if len(head) < length:
        return MORE
    return length if sum(head[1 : length - 1]) & 0xFF == head[length - 1] else BAD


JrtParser = partial(
    Decoder[JrtFrame], partial(FrameSplitter, b"\xaa\xee", _measure_jrt),
    lambda one: JrtFrame(one[0] == 0xEE, int.from_bytes(one[2:4], "big"), one[6:-1]),
)  # fmt: skip


class LaserDevice(LineDevice[Transport[E]]):
    """A device whose laser the bytes `off` switch off, also at its end."""

    off: ClassVar[bytes]

    def close(self) -> None:
        """Switch the laser off, and release the line."""
        with suppress(DeviceError):
            self._transport.write(self.off)
        super().close()

    def emergency_stop(self) -> None:
        """Switch the laser off, which ends a measurement."""
        self._transport.preempt(self.off, EmergencyStopped(f"emergency stop at {self.address}", "measure again"))


class JrtRangefinder(LaserDevice[JrtFrame]):
    """A Rangefinder of the JRT/Meskernel/M88 family."""

    off = STOP + bytes.fromhex("AA0001BE00010000C0")

    def connect(self) -> Identity:
        """Open, let the module detect the baud rate, read its version. Raises DeviceError."""
        with opened(self._transport):
            self._transport.write(WAKE)
            self.clock.sleep(0.1)
            version = self._read(VERSION)
        return Identity("JRT/Meskernel module", version.hex(), "", self.address)

    def _read(self, register: int) -> bytes:
        command = bytes((0x80, register >> 8, register & 0xFF))
        request = b"\xaa" + command + bytes((sum(command) & 0xFF,))
        return self._ask(request, register, REPLY_S, tries=3).payload

    def _ask(self, command: bytes, register: int, timeout_s: float, tries: int = 1) -> JrtFrame:
        frame = self._transport.request(
            command, lambda f: f if f.error or f.register == register else None, timeout_s, tries
        )
        if frame.error:
            code = int.from_bytes(frame.payload[-2:], "big")
            reason, remedy = STATUSES.get(code, (f"its hardware failed (status {code})", "switch it off and on"))
            raise NoReading(f"{self.address}: {reason}", remedy, code)
        return frame

    def measure(self) -> Distance:
        """One reading; repeated more slowly if the echo is weak or absent. Raises DeviceError."""
        try:
            frame = self._ask(MEASURE_AUTO, RESULT, AUTO_S)
        except NoAnswer:
            self._transport.write(STOP)
            frame = self._ask(MEASURE_SLOW, RESULT, SLOW_S)
        except NoReading as error:
            if error.code != 8:
                raise
            frame = self._ask(MEASURE_SLOW, RESULT, SLOW_S)
        if len(frame.payload) != 6:
            raise NoReading(f"{self.address} sent a result of {len(frame.payload)} bytes", "measure again")
        distance, quality = int.from_bytes(frame.payload[:4], "big"), int.from_bytes(frame.payload[4:], "big")
        return Distance(float(distance), self.clock.now_s(), quality)

    def laser(self, on: bool) -> None:
        payload = bytes((0x00, 0x01, 0xBE, 0x00, 0x01, 0x00, int(on)))
        self._ask(b"\xaa" + payload + bytes((sum(payload) & 0xFF,)), LASER, REPLY_S)


def crc8(data: bytes) -> int:
    """Bosch's CRC: start 0xAA, polynomial 0xA6, most significant bit first."""
    value = 0xAA
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = (value << 1) ^ (0xA6 if value & 0x80 else 0)
            value &= 0xFF
    return value


@dataclass(frozen=True)
class BoschFrame:
    """One valid answer: status and payload."""

    status: int
    payload: bytes


def _measure_bosch(head: bytes) -> int:
    if len(head) < 2:
        return MORE
    length = head[1] + 3
    if head[1] not in (0, 4):
        return BAD
    if len(head) < length:
        return MORE
    return length if crc8(head[: length - 1]) == head[length - 1] else BAD


BoschParser = partial(
    Decoder[BoschFrame], partial(FrameSplitter, bytes((0, *BOSCH_STATUSES)), _measure_bosch),
    lambda one: BoschFrame(one[0], one[2:-1]),
)  # fmt: skip


class BoschRangefinder(LaserDevice[BoschFrame]):
    """A Rangefinder for Bosch GLM and PLR instruments."""

    off = b"\xc0\x42\x00\x1e"

    def connect(self) -> Identity:
        """Open and switch the laser spot on, which any GLM answers, and off. Raises DeviceError."""
        with opened(self._transport):
            self.laser(True)
            self.laser(False)
        return Identity("Bosch GLM", "", "", self.address)

    def _ask(self, command: int, payload_bytes: int, timeout_s: float) -> bytes:
        request = bytes((0xC0, command, 0x00))
        frame = self._transport.request(
            request + bytes((crc8(request),)),
            lambda f: f if f.status or len(f.payload) == payload_bytes else None,
            timeout_s,
        )
        if frame.status:
            reason, remedy = BOSCH_STATUSES[frame.status]
            raise NoReading(f"{self.address}: {reason}", remedy, frame.status)
        return frame.payload

    def measure(self) -> Distance:
        """One reading, with a resolution of 0.05 mm; the spot must not be in a photograph. Raises DeviceError."""
        try:
            payload = self._ask(0x40, 4, AUTO_S)
        finally:
            with suppress(DeviceError):
                self.laser(False)
        return Distance(int.from_bytes(payload, "little") * 0.05, self.clock.now_s())

    def laser(self, on: bool) -> None:
        self._ask(0x41 if on else 0x42, 0, REPLY_S)


@dataclass(frozen=True, kw_only=True)
class JrtOptions(LineOptions):
    """Options of driver "jrt"."""

    makes = JrtRangefinder
    parser = JrtParser
    baud: Baud = 19200


@dataclass(frozen=True, kw_only=True)
class BoschOptions(LineOptions):
    """Options of driver "bosch"."""

    makes = BoschRangefinder
    parser = BoschParser
