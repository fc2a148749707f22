"""IMUs: WitMotion modules (to 200 Hz: settling and sway) and fast accelerometers (to some kHz: shutter shock).

Samples carry the device's time and the host's: the device's plus the smallest offset in the block, that of the delivery
with the least delay.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from drivers.clock import Clock, SystemClock
from drivers.errors import BadConfiguration, EmergencyStopped, NoAnswer, Rejected
from drivers.interfaces import Condition, Identity, ImuBlock, Transport
from drivers.making import LineOptions, MakerContext
from drivers.options import positive
from drivers.protocols.imu import FastParser, SampleBatch, TextMessage, WitFrame, WitParser
from drivers.wire.connection import line_condition, opened

G_M_S2 = 9.80665
RATES_HZ = {0.2: 1, 0.5: 2, 1.0: 3, 2.0: 4, 5.0: 5, 10.0: 6, 20.0: 7, 50.0: 8, 100.0: 9, 200.0: 0x0B}
NO_OUTPUT = 0x0D
UNLOCK, SAVE = b"\xff\xaa\x69\x88\xb5", b"\xff\xaa\x00\x00\x00"
CONTENT, RATE, BANDWIDTH, READ = 0x02, 0x03, 0x1F, 0x27
TIME_ACCELERATION_GYRO = 0x0007
SETTLE_S = 0.02  # the module needs this between two register writes
REPLY_S = 1.0


@dataclass(frozen=True)
class ImuSample:
    """One sample with its time of reception."""

    device_s: float
    received_s: float
    row: tuple[float, ...]


def block_of(samples: Sequence[ImuSample], lost: int) -> ImuBlock:
    """Samples with both clocks; rows are three accelerations in m/s^2, then three angular rates in rad/s."""
    device = np.array([s.device_s for s in samples])
    received = np.array([s.received_s for s in samples])
    rows = np.array([s.row for s in samples]).reshape(-1, 6)
    offset = float(np.min(received - device)) if samples else 0.0
    return ImuBlock(device, device + offset, rows[:, :3], rows[:, 3:], lost)


class _Stream:
    """Samples passed from the reader thread to the caller of `read_block`."""

    def __init__(self) -> None:
        self._samples: list[ImuSample] = []
        self._lost = 0
        self.rate_hz = 0.0

    def start(self, rate_hz: float) -> None:
        self._samples, self._lost, self.rate_hz = [], 0, rate_hz

    def put(self, sample: ImuSample, lost: int) -> None:
        self._samples.append(sample)
        self._lost += lost

    def take(self, address: str, duration_s: float) -> ImuBlock:
        samples, self._samples = self._samples, []
        lost, self._lost = self._lost, 0
        if not samples and duration_s * self.rate_hz > 5:
            raise NoAnswer(f"{address} sent no samples in {duration_s:g} s", "check its cable, then connect again")
        return block_of(samples, lost)


class WitImu:
    """A WitMotion module in WIT standard protocol."""

    def __init__(self, transport: Transport[WitFrame], *, clock: Clock | None = None) -> None:
        self.clock = clock or SystemClock()
        self._transport = transport
        self._stream = _Stream()
        self._device_s: float | None = None
        self._before_s: float | None = None
        self._acceleration: tuple[float, ...] | None = None
        self._version = ""

    @property
    def address(self) -> str:
        """The port or URL."""
        return self._transport.address

    def connect(self) -> Identity:
        """Open, read back a register, and stop the stream that starts at power-up. Raises DeviceError."""
        with opened(self._transport, self._hear):
            if self._register(RATE) != NO_OUTPUT:
                self.stop()
        return Identity("WitMotion", self._version, "", self.address)

    def close(self) -> None:
        """Release the line."""
        self._transport.close()

    def condition(self) -> Condition:
        """Whether it streams."""
        return line_condition(
            self._transport.is_open, f"{self._stream.rate_hz:g} Hz" if self._stream.rate_hz else "ready"
        )

    def _register(self, number: int) -> int:
        """Read a register; retried, because the answer is sometimes lost in a fast stream."""
        frame = self._transport.request(
            bytes((0xFF, 0xAA, READ, number, 0)), lambda f: f if f.kind == 0x5F else None, REPLY_S, tries=3
        )
        return frame.words[0] & 0xFFFF

    def _set(self, number: int, value: int) -> None:
        self._transport.write(bytes((0xFF, 0xAA, number, value & 0xFF, value >> 8)))
        self.clock.sleep(SETTLE_S)

    def start(self, rate_hz: float) -> None:
        """Stream time, acceleration and rotation with the widest filter. Raises DeviceError."""
        if rate_hz not in RATES_HZ:
            raise BadConfiguration(f"{self.address} cannot sample at {rate_hz:g} Hz", f"use one of {sorted(RATES_HZ)}")
        self._write_registers({CONTENT: TIME_ACCELERATION_GYRO, BANDWIDTH: 0, RATE: RATES_HZ[rate_hz]})
        self._before_s = None
        self._stream.start(rate_hz)

    def stop(self) -> None:
        """Stop streaming. Raises DeviceError."""
        self._stream.rate_hz = 0.0
        self._write_registers({RATE: NO_OUTPUT})

    def _write_registers(self, wanted: dict[int, int]) -> None:
        self._transport.write(UNLOCK)
        self.clock.sleep(SETTLE_S)
        for number, value in wanted.items():
            self._set(number, value)
        self._transport.write(SAVE)
        self.clock.sleep(SETTLE_S)
        got = self._register(RATE)
        if got != wanted[RATE]:
            raise Rejected(f"{self.address} reads rate register {got:#x} instead of {wanted[RATE]:#x}", "set it again")

    def _hear(self, frame: WitFrame, host_s: float) -> None:
        match frame.kind:
            case 0x50:
                self._device_s = frame.seconds()
            case 0x51:
                self._acceleration = tuple(word / 32768 * 16 * G_M_S2 for word in frame.words[:3])
            case 0x52 if self._acceleration is not None and self._device_s is not None and self._stream.rate_hz:
                rate = tuple(math.radians(word / 32768 * 2000) for word in frame.words[:3])
                self._stream.put(ImuSample(self._device_s, host_s, (*self._acceleration, *rate)), self._missing())
                self._before_s, self._acceleration, self._device_s = self._device_s, None, None
            case 0x53:
                self._version = f"{frame.words[3] & 0xFFFF}"

    def _missing(self) -> int:
        """Number of lost samples, from the gap in the device's time."""
        if self._before_s is None or self._device_s is None:
            return 0
        return max(round((self._device_s - self._before_s) * self._stream.rate_hz) - 1, 0)

    def read_block(self, duration_s: float) -> ImuBlock:
        """Samples since the last block and during the next `duration_s`. Raises NoAnswer, LineLost."""
        self._transport.wait(lambda: False, duration_s)
        return self._stream.take(self.address, duration_s)

    def emergency_stop(self) -> None:
        """Harmless: only ends the waits."""
        self._transport.preempt(b"", EmergencyStopped(f"emergency stop at {self.address}", "start it again"))


class FastImu:
    """A fast accelerometer and gyroscope; commands `ID?`, `START <hz>`, `STOP` are answered by text messages."""

    def __init__(
        self,
        transport: Transport[SampleBatch | TextMessage],
        *,
        clock: Clock | None = None,
        full_scale_g: float = 8.0,
        full_scale_deg_s: float = 500.0,
    ) -> None:
        self.clock = clock or SystemClock()
        self._transport = transport
        self._scale = [full_scale_g * G_M_S2 / 32768] * 3 + [math.radians(full_scale_deg_s) / 32768] * 3
        self._stream = _Stream()
        self._seq: int | None = None

    @property
    def address(self) -> str:
        """The port or URL."""
        return self._transport.address

    def connect(self) -> Identity:
        """Open and identify the device. Raises DeviceError."""
        with opened(self._transport, self._hear):
            model, firmware, serial = (*self._ask("ID?").split(" "), "", "", "")[:3]
        return Identity(model, firmware, serial, self.address)

    def _ask(self, line: str) -> str:
        return self._transport.request(
            f"{line}\n".encode(), lambda e: e.text if isinstance(e, TextMessage) else None, REPLY_S, tries=3
        )

    def close(self) -> None:
        """Release the line."""
        self._transport.close()

    def condition(self) -> Condition:
        """Whether it streams."""
        return line_condition(
            self._transport.is_open, f"{self._stream.rate_hz:g} Hz" if self._stream.rate_hz else "ready"
        )

    def start(self, rate_hz: float) -> None:
        """Stream at this rate. Raises DeviceError."""
        self._seq = None
        self._stream.start(rate_hz)
        self._expect(f"START {rate_hz:g}")

    def stop(self) -> None:
        """Stop streaming. Raises DeviceError."""
        self._stream.rate_hz = 0.0
        self._expect("STOP")

    def _expect(self, line: str) -> None:
        answer = self._ask(line)
        if answer != "OK":
            raise Rejected(f"{self.address} refused {line!r}: {answer}", "choose another rate, or check the cable")

    def _hear(self, event: SampleBatch | TextMessage, host_s: float) -> None:
        if isinstance(event, TextMessage) or not self._stream.rate_hz:
            return
        gap = 0 if self._seq is None else (event.seq - self._seq - 1) % 65536
        self._seq = event.seq
        for i, row in enumerate(event.rows):
            device_s = event.t0_us * 1e-6 + i * event.dt_ns * 1e-9
            values = tuple(number * scale for number, scale in zip(row, self._scale, strict=True))
            self._stream.put(ImuSample(device_s, host_s, values), gap * len(event.rows) if i == 0 else 0)

    def read_block(self, duration_s: float) -> ImuBlock:
        """Samples since the last block and during the next `duration_s`. Raises NoAnswer, LineLost."""
        self._transport.wait(lambda: False, duration_s)
        return self._stream.take(self.address, duration_s)

    def emergency_stop(self) -> None:
        """Harmless: only ends the waits."""
        self._transport.preempt(b"", EmergencyStopped(f"emergency stop at {self.address}", "start it again"))


@dataclass(frozen=True, kw_only=True)
class WitOptions(LineOptions):
    """Options of driver "wit"."""

    def make(self, parts: MakerContext) -> WitImu:
        """The IMU."""
        return WitImu(parts.wire(self.port, WitParser, baud=self.baud), clock=parts.clock)


@dataclass(frozen=True, kw_only=True)
class FastOptions(LineOptions):
    """Options of driver "fast"."""

    full_scale_g: Annotated[float, positive("8")] = 8.0
    full_scale_deg_s: Annotated[float, positive("500")] = 500.0

    def make(self, parts: MakerContext) -> FastImu:
        """The IMU."""
        wire = parts.wire(self.port, FastParser, baud=self.baud)
        scale = {"full_scale_g": self.full_scale_g, "full_scale_deg_s": self.full_scale_deg_s}
        return FastImu(wire, clock=parts.clock, **scale)
