"""IMUs at byte level: a WitMotion module, and a fast accelerometer that speaks the COBS frame.

They sample what the world reports for an ideal IMU on the camera, add noise, and deliver samples in the batches
of USB adapters.
"""

import struct

import numpy as np
from numpy.typing import NDArray

from simulators.devices.serial_device import SerialDevice, drained
from simulators.world.world import World

Array = NDArray[np.float64]
G = 9.80665
NEVER = float("inf")
BATCH_S = 0.016
LONGEST_BACKLOG = 256  # unread samples are overwritten
RATES_HZ = {1: 0.2, 2: 0.5, 3: 1.0, 4: 2.0, 5: 5.0, 6: 10.0, 7: 20.0, 8: 50.0, 9: 100.0, 11: 200.0}
# acceleration, gyro, angle, magnetic field at 10 Hz, 20 Hz wide; its version
FACTORY = {0x02: 0x001E, 0x03: 0x0006, 0x1F: 0x0004, 0x2E: 4405}
UNLOCKED_S = 10.0


class Sampler:
    """Sample times at a rate, delivered in batches."""

    def __init__(self) -> None:
        self.rate_hz = 0.0
        self._next_s = NEVER
        self._batch_s = NEVER

    def start(self, rate_hz: float, now_s: float) -> None:
        """Sample from now on; rate 0 stops."""
        self.rate_hz = rate_hz
        self._next_s = now_s + 1 / rate_hz if rate_hz else NEVER
        self._batch_s = self._next_s if rate_hz < 1 / BATCH_S else now_s + BATCH_S
        if not rate_hz:
            self._batch_s = NEVER

    def due_s(self) -> float | None:
        """When the next batch is delivered."""
        return None if self._batch_s == NEVER else self._batch_s

    def take(self, now_s: float) -> Array:
        """Sample times of the batches due by now."""
        if now_s < self._batch_s:
            return np.empty(0)
        count = int((now_s - self._next_s) * self.rate_hz + 1e-6) + 1
        kept = min(max(count, 0), LONGEST_BACKLOG)
        times = self._next_s + (count - kept + np.arange(kept)) / self.rate_hz
        self._next_s += count / self.rate_hz
        self._batch_s = max(self._next_s, now_s + BATCH_S)
        return times


def digits(values: Array, full_scale: float) -> NDArray[np.int16]:
    """Signed 16-bit numbers, clipped as converters do."""
    return np.clip(np.round(values / full_scale * 32768), -32768, 32767).astype(np.int16)


class WitModule(SerialDevice):
    """A WitMotion module: registers, and frames `55 TT ... SUM`; a fraction `lose` of its samples is never sent."""

    baud = 115200

    def __init__(self, world: World, rng: np.random.Generator, *, noise_g: float = 0.002, lose: float = 0.0) -> None:
        self._world, self._rng = world, rng
        self._noise_g, self._lose = noise_g, lose
        self._registers = dict(FACTORY)
        self._unlocked_until_s = -NEVER
        self._sampler = Sampler()
        self._inbox = b""
        self._out = bytearray()
        self._sampler.start(RATES_HZ[self._registers[0x03]], 0.0)

    def receive(self, data: bytes, now_s: float) -> None:
        """`FF AA register low high`."""
        self._inbox = (self._inbox + data)[-64:]
        while (at := self._inbox.find(b"\xff\xaa")) >= 0 and len(self._inbox) >= at + 5:
            number, low, high = self._inbox[at + 2 : at + 5]
            self._inbox = self._inbox[at + 5 :]
            value = low | high << 8
            if number == 0x69:
                self._unlocked_until_s = now_s + UNLOCKED_S if value == 0xB588 else -NEVER
            elif number == 0x27:
                self._send(0x5F, struct.pack("<4H", *(self._registers.get(value % 256 + i, 0) for i in range(4))))
            elif number and now_s < self._unlocked_until_s:
                self._registers[number] = value
                if number == 0x03:
                    self._sampler.start(RATES_HZ.get(value, 0.0), now_s)

    def _send(self, kind: int, data: bytes) -> None:
        frame = bytes((0x55, kind)) + data
        self._out += frame + bytes((sum(frame) & 0xFF,))

    def advance(self, now_s: float) -> bytes:
        times = self._sampler.take(now_s)
        if times.size:
            force, rate = self._world.ideal_imu(times)
            force = force + self._rng.normal(0, self._noise_g * G, force.shape)
            rate = rate + self._rng.normal(0, 0.001, rate.shape)
            sent = self._rng.random(times.size) >= self._lose
            for t_s, f, r, send in zip(times, digits(force, 16 * G), digits(rate, np.radians(2000)), sent, strict=True):
                if send:
                    self._report(float(t_s), f, r)
        return drained(self._out)

    def _report(self, t_s: float, force: NDArray[np.int16], rate: NDArray[np.int16]) -> None:
        celsius = round(self._world.temperature_c(t_s) * 100)
        content = self._registers[0x02]
        if content & 1:
            ms = round(t_s * 1000)
            clock = (26, 1, 1 + ms // 86_400_000 % 28, ms // 3_600_000 % 24, ms // 60_000 % 60, ms // 1000 % 60)
            self._send(0x50, bytes(clock) + struct.pack("<H", ms % 1000))
        if content & 2:
            self._send(0x51, struct.pack("<4h", *force, celsius))
        if content & 4:
            self._send(0x52, struct.pack("<4h", *rate, celsius))
        if content & 8:
            self._send(0x53, struct.pack("<3hH", 0, 0, 0, self._registers[0x2E]))

    def next_event_s(self) -> float | None:
        return self._sampler.due_s()


def stuff(data: bytes) -> bytes:
    """COBS without its closing zero."""
    out = bytearray()
    for block in data.split(b"\0"):
        for i in range(0, len(block) - 253, 254):
            out += b"\xff" + block[i : i + 254]
        rest = block[len(block) // 254 * 254 :]
        out += bytes((len(rest) + 1,)) + rest
    return bytes(out)


def ccitt(data: bytes) -> int:
    """CRC-16, polynomial 0x1021, start 0xFFFF, bit by bit."""
    value = 0xFFFF
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = ((value << 1) ^ (0x1021 if value & 0x8000 else 0)) & 0xFFFF
    return value


def box_reading(world: World, rng: np.random.Generator, t_s: float, *, noise_g: float = 0.002) -> list[int]:
    """The digits of an ideal unit with noise, of 8 g and 500 degrees per second, on a STRIG box."""
    force, rate = world.ideal_imu(np.array([t_s]))
    force = force + rng.normal(0, noise_g * G, force.shape)
    numbers: list[int] = np.hstack([digits(force, 8 * G), digits(rate, np.radians(500))])[0].tolist()
    return numbers


class FastModule(SerialDevice):
    """A fast accelerometer and gyroscope on a small board with a clock of its own."""

    baud = 115200

    def __init__(
        self, world: World, rng: np.random.Generator, *, noise_g: float = 0.0005, drift: float = 30e-6
    ) -> None:
        self._world, self._rng = world, rng
        self._noise_g, self._drift = noise_g, drift
        self._sampler = Sampler()
        self._line = bytearray()
        self._out = bytearray()
        self._seq = 0

    def receive(self, data: bytes, now_s: float) -> None:
        """`ID?`, `START hz`, `STOP`."""
        for byte in data:
            if byte == 10:
                line, self._line = self._line.decode("ascii", "replace"), bytearray()
                self._send(b"\0" + self._obey(line, now_s).encode())
            elif len(self._line) < 64:
                self._line.append(byte)

    def _obey(self, line: str, now_s: float) -> str:
        match line.split(" "):
            case ["ID?"]:
                return "FASTIMU/1 1.0 SIM-1"
            case ["STOP"]:
                self._sampler.start(0.0, now_s)
                return "OK"
            case ["START", rate] if rate.isascii() and rate.isdigit() and 1 <= int(rate) <= 4000:
                self._sampler.start(float(rate), now_s)
                return "OK"
        return "ERR unknown command"

    def _send(self, body: bytes) -> None:
        self._out += stuff(body + struct.pack("<H", ccitt(body))) + b"\0"

    def advance(self, now_s: float) -> bytes:
        times = self._sampler.take(now_s)
        for i in range(0, times.size, 32):
            self._batch(times[i : i + 32])
        return drained(self._out)

    def _batch(self, times: Array) -> None:
        force, rate = self._world.ideal_imu(times)
        force = force + self._rng.normal(0, self._noise_g * G, force.shape)
        rows = np.hstack([digits(force, 8 * G), digits(rate, np.radians(500))]).astype("<i2")
        step_ns = round(1e9 / self._sampler.rate_hz * (1 + self._drift))
        head = struct.pack("<BHBQI", 1, self._seq, times.size, round(times[0] * (1 + self._drift) * 1e6), step_ns)
        self._seq = (self._seq + 1) % 65536
        self._send(head + rows.tobytes())

    def next_event_s(self) -> float | None:
        return self._sampler.due_s()
