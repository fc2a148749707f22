"""IMUs: WitMotion modules (to 200 Hz: settling and sway), fast accelerometers (to some kHz: shutter shock), and a unit
on a STRIG box, which shares the clock of shutter, flash and shaker.

Samples carry the device's time and the host's. On a cable of its own a unit's samples come late by what the cable and
its adapter take. The delivery with the least delay gives the offset of the clocks except for that delay, which lies
between zero and the shortest round trip; an event seen by two units (`station devices --tap`) measures it.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Generic, TypeVar

import numpy as np

from drivers.errors import BadConfiguration, Clock, EmergencyStopped, NoAnswer, Rejected
from drivers.interfaces import ClockOffset, Identity, ImuBlock, Transport
from drivers.making import DriverOptions, LineOptions, MakerContext
from drivers.options import STRIG_BOX, device, option, positive
from drivers.protocols.imu import FastParser, SampleBatch, TextMessage, WitFrame, WitParser
from drivers.shutter import DRIFT, BoxDevice, Sample, StrigShutter
from drivers.wire.connection import LineDevice, opened

E = TypeVar("E")
G_M_S2 = 9.80665
RATES_HZ = {0.2: 1, 0.5: 2, 1.0: 3, 2.0: 4, 5.0: 5, 10.0: 6, 20.0: 7, 50.0: 8, 100.0: 9, 200.0: 0x0B}
NO_OUTPUT = 0x0D
UNLOCK, SAVE = b"\xff\xaa\x69\x88\xb5", b"\xff\xaa\x00\x00\x00"
CONTENT, RATE, BANDWIDTH, READ, VERSION = 0x02, 0x03, 0x1F, 0x27, 0x2E
TIME_ACCELERATION_GYRO = 0x0007
SETTLE_S = 0.02  # the module needs this between two register writes
REPLY_S = 1.0
ROUND_TRIPS = 5
LEAST_SPAN_S = 10.0  # time between two blocks from which on they determine the drift better than the bound of a crystal
MOST_BOX_HZ = 200
FILTER_S = 0.002  # bound of the delay in the filters of the unit on a box


@dataclass(frozen=True)
class ImuSample:
    """One sample with its time of reception."""

    device_s: float
    received_s: float
    row: tuple[float, ...]


@dataclass(frozen=True)
class CableLatency:
    """Least delay of a unit's samples, with its bound: from round trips, or measured by an event (`by`)."""

    latency_s: float
    within_s: float
    by: str = "round trip"


@dataclass(frozen=True)
class LeastOffset:
    """Smallest difference between reception and device time in a block, when, and its bound."""

    device_s: float
    offset_s: float
    within_s: float


def rows_of(samples: Sequence[ImuSample]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Device times, accelerations in m/s^2, and angular rates in rad/s."""
    rows = np.array([s.row for s in samples]).reshape(-1, 6)
    return np.array([s.device_s for s in samples]), rows[:, :3], rows[:, 3:]


class _Stream:
    """Samples passed from the reader thread to the caller of `read_block`; `resolution_s` is that of their times."""

    def __init__(self, resolution_s: float, latency: CableLatency | None = None) -> None:
        self._samples: list[ImuSample] = []
        self._lost = 0
        self.rate_hz = 0.0
        self._resolution_s = resolution_s
        self._measured = latency
        self.latency = latency or CableLatency(0.0, 0.0)
        self._first: LeastOffset | None = None

    def start(self, rate_hz: float, clock: Clock, ask: Callable[[], object]) -> None:
        """Begin anew, and bound the delay by the shortest of some round trips."""
        self._samples, self._lost, self.rate_hz = [], 0, rate_hz
        if self._measured is None:
            trips = []
            for _ in range(ROUND_TRIPS):
                asked_s = clock.now_s()
                ask()
                trips.append(clock.now_s() - asked_s)
            self.latency = CableLatency(min(trips) / 2, min(trips) / 2)

    def put(self, sample: ImuSample, lost: int) -> None:
        self._samples.append(sample)
        self._lost += lost

    def take(self, address: str, duration_s: float) -> ImuBlock:
        samples, self._samples = self._samples, []
        lost, self._lost = self._lost, 0
        if not samples and duration_s * self.rate_hz > 5:
            raise NoAnswer(f"{address} sent no samples in {duration_s:g} s", "check its cable, then connect again")
        device_s, force, rate = rows_of(samples)
        if not samples:
            return ImuBlock(device_s, device_s, force, rate, lost)
        clock = self._clock_of(samples)
        return ImuBlock(device_s, device_s + clock.offset_s, force, rate, lost, clock)

    def _clock_of(self, samples: Sequence[ImuSample]) -> ClockOffset:
        """The clocks' offset in this block. Its freshest delivery may wait for a part of a period."""
        offset_s, device_s = min((sample.received_s - sample.device_s, sample.device_s) for sample in samples)
        waited_s = 1 / (self.rate_hz * len({sample.received_s for sample in samples}))
        least = LeastOffset(device_s, offset_s, self._resolution_s + waited_s)
        first = self._first = self._first or least
        drift, drift_within, span_s = 0.0, DRIFT, device_s - first.device_s
        if span_s > LEAST_SPAN_S:  # the cable's delay is the same in both
            drift, drift_within = (first.offset_s - offset_s) / span_s, (first.within_s + least.within_s) / span_s
        latency = self.latency
        within_s = latency.within_s + least.within_s
        return ClockOffset(offset_s - latency.latency_s, within_s, drift, drift_within, latency.by)


def scale_of(full_scale_g: float, full_scale_deg_s: float) -> list[float]:
    """Unit per digit of three accelerations and three rates."""
    return [full_scale_g * G_M_S2 / 32768] * 3 + [math.radians(full_scale_deg_s) / 32768] * 3


class StreamingImu(LineDevice[Transport[E]], Generic[E]):
    """A unit on a cable of its own."""

    def __init__(self, transport: Transport[E], clock: Clock | None, stream: _Stream) -> None:
        super().__init__(transport, clock)
        self._stream = stream

    @property
    def latency(self) -> CableLatency:
        """The delay assumed of its samples."""
        return self._stream.latency

    @property
    def _word(self) -> str:
        return f"{self._stream.rate_hz:g} Hz" if self._stream.rate_hz else "ready"

    def read_block(self, duration_s: float) -> ImuBlock:
        self._transport.wait(lambda: False, duration_s)
        return self._stream.take(self.address, duration_s)

    def emergency_stop(self) -> None:
        """Harmless: only ends the waits."""
        self._transport.preempt(b"", EmergencyStopped(f"emergency stop at {self.address}", "start it again"))


class WitImu(StreamingImu[WitFrame]):
    """A WitMotion module in WIT standard protocol."""

    def __init__(
        self, transport: Transport[WitFrame], *, clock: Clock | None = None, latency: CableLatency | None = None
    ) -> None:
        super().__init__(transport, clock, _Stream(1e-3, latency))
        self._device_s: float | None = None
        self._before_s: float | None = None
        self._acceleration: tuple[float, ...] | None = None

    def connect(self) -> Identity:
        """Open, read its version, and stop the stream that starts at power-up. Raises DeviceError."""
        with opened(self._transport, self._hear):
            version = self._register(VERSION)
            if self._register(RATE) != NO_OUTPUT:
                self.stop()
        return Identity("WitMotion", str(version or ""), "", self.address)

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
        self._stream.start(rate_hz, self.clock, lambda: self._register(RATE))

    def stop(self) -> None:
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

    def _missing(self) -> int:
        if self._before_s is None or self._device_s is None:
            return 0
        return max(round((self._device_s - self._before_s) * self._stream.rate_hz) - 1, 0)


class FastImu(StreamingImu[SampleBatch | TextMessage]):
    """A fast accelerometer and gyroscope; commands `ID?`, `START <hz>`, `STOP` are answered by text messages."""

    def __init__(
        self, transport: Transport[SampleBatch | TextMessage], *, clock: Clock | None = None,
        full_scale_g: float = 8.0, full_scale_deg_s: float = 500.0, latency: CableLatency | None = None,
    ) -> None:  # fmt: skip
        super().__init__(transport, clock, _Stream(1e-6, latency))
        self._scale = scale_of(full_scale_g, full_scale_deg_s)
        self._seq: int | None = None

    def connect(self) -> Identity:
        with opened(self._transport, self._hear):
            model, firmware, serial = (*self._ask("ID?").split(" "), "", "", "")[:3]
        return Identity(model, firmware, serial, self.address)

    def _ask(self, line: str) -> str:
        return self._transport.request(
            f"{line}\n".encode(), lambda e: e.text if isinstance(e, TextMessage) else None, REPLY_S, tries=3
        )

    def start(self, rate_hz: float) -> None:
        self._seq = None
        self._stream.start(rate_hz, self.clock, lambda: self._ask("ID?"))
        self._expect(f"START {rate_hz:g}")

    def stop(self) -> None:
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


class StrigImu(BoxDevice):
    """An inertial unit on a box that a StrigShutter has connected: on the clock of shutter, flash and shaker."""

    what, since = "inertial unit", 4

    def __init__(self, box: StrigShutter, *, clock: Clock | None = None) -> None:
        super().__init__(box, clock)
        self._scale = scale_of(8.0, 500.0)
        self._samples: list[Sample] = []
        self._rate_hz = 0.0

    def connect(self) -> Identity:
        """Check that the box has a unit. Raises BadConfiguration, LineLost, Rejected."""
        identity = super().connect()
        self._box.on_sample = self._samples.append
        self.stop()
        return identity

    @property
    def _word(self) -> str:
        return f"{self._rate_hz:g} Hz" if self._rate_hz else "ready"

    def start(self, rate_hz: float) -> None:
        """Stream at this rate, a whole number up to 200 Hz. Raises DeviceError."""
        self._require()
        if not 1 <= round(rate_hz) <= MOST_BOX_HZ:
            raise BadConfiguration(f"{self.address} cannot sample at {rate_hz:g} Hz", f"use one of 1 to {MOST_BOX_HZ}")
        self._box.synchronise()
        self._box.command(f"IMU {rate_hz:.0f}")
        self._samples.clear()
        self._rate_hz = round(rate_hz)

    def stop(self) -> None:
        self._rate_hz = 0.0
        self._require()
        self._box.command("IMU 0")

    def read_block(self, duration_s: float) -> ImuBlock:
        self._box.wait(lambda: False, duration_s)
        taken = self._samples[:]
        del self._samples[: len(taken)]
        if not taken and duration_s * self._rate_hz > 5:
            raise NoAnswer(f"{self.address} sent no samples in {duration_s:g} s", "check its cable, then connect again")
        device_s, force, rate = rows_of([ImuSample(one.t_us * 1e-6, 0.0, self._row(one)) for one in taken])
        if not taken:
            return ImuBlock(device_s, device_s, force, rate, 0)
        lost = max(round((device_s[-1] - device_s[0]) * self._rate_hz) + 1 - len(taken), 0)
        offset_s, within_s = self._box.to_host_s(0), self._box.within_s(taken[-1].t_us) + FILTER_S
        return ImuBlock(
            device_s, device_s + offset_s, force, rate, lost, ClockOffset(offset_s, within_s, 0.0, DRIFT, "box")
        )

    def _row(self, sample: Sample) -> tuple[float, ...]:
        return tuple(digits * scale for digits, scale in zip(sample.digits, self._scale, strict=True))

    def emergency_stop(self) -> None:
        """No-op: the box is stopped by its shutter."""


@dataclass(frozen=True, kw_only=True)
class CableOptions(LineOptions):
    """Options of a unit on a cable of its own: the measured delay of its samples; by default round trips bound it."""

    latency_s: Annotated[float, option("0.012", least=0)] | None = None
    latency_within_s: Annotated[float, option("0.001", least=0)] = 1e-3

    @property
    def latency(self) -> CableLatency | None:
        """The measured delay."""
        if self.latency_s is None:
            return None
        return CableLatency(self.latency_s, self.latency_within_s, "common event")


@dataclass(frozen=True, kw_only=True)
class StrigImuOptions(DriverOptions):
    """Options of driver "strig_imu"."""

    box: Annotated[str, device(STRIG_BOX, '"shutter"')]

    def make(self, parts: MakerContext) -> StrigImu:
        return StrigImu(parts.other(self.box), clock=parts.clock)


@dataclass(frozen=True, kw_only=True)
class WitOptions(CableOptions):
    """Options of driver "wit"."""

    def make(self, parts: MakerContext) -> WitImu:
        return WitImu(parts.wire(self.port, WitParser, baud=self.baud), clock=parts.clock, latency=self.latency)


@dataclass(frozen=True, kw_only=True)
class FastOptions(CableOptions):
    """Options of driver "fast"."""

    full_scale_g: Annotated[float, positive("8")] = 8.0
    full_scale_deg_s: Annotated[float, positive("500")] = 500.0

    def make(self, parts: MakerContext) -> FastImu:
        wire = parts.wire(self.port, FastParser, baud=self.baud)
        scale = {"full_scale_g": self.full_scale_g, "full_scale_deg_s": self.full_scale_deg_s}
        return FastImu(wire, clock=parts.clock, latency=self.latency, **scale)
