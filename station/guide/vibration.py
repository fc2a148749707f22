"""Settling of the rig: detected by the IMU relative to its noise at rest, or awaited without one."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from drivers.errors import Clock, DeviceError
from drivers.interfaces import Imu, ImuBlock
from procedures.numerics.arrays import Array


@dataclass(frozen=True)
class SettlingTimeouts:
    """How long to wait for the rig to settle, and when it counts as settled.

    frequency_hz, damping : of the stage's slowest mode. Without an IMU the wait lasts until that mode has decayed to
        the fraction `quiet`.
    rate_hz, window_s : sampling rate of the IMU, and duration of a block
    factor : largest vibration level of a settled rig, relative to the noise at rest. The root mean square of 40 samples
        of three axes scatters by 6 %: 1.4 is more than six standard deviations.
    longest_s : timeout
    """

    frequency_hz: float = 8.0
    damping: float = 0.03
    quiet: float = 1e-2
    rate_hz: float = 100.0
    window_s: float = 0.4
    factor: float = 1.4
    longest_s: float = 20.0

    @property
    def decay_s(self) -> float:
        """Time t after which exp(-2 pi damping frequency t) = quiet."""
        return -math.log(self.quiet) / (2 * math.pi * self.damping * self.frequency_hz)


class VibrationLevel(NamedTuple):
    """Standard deviations of acceleration in m/s^2 and of rotation rate in rad/s."""

    acceleration_m_s2: float
    rotation_rad_s: float

    @classmethod
    def of(cls, block: ImuBlock) -> "VibrationLevel":
        """Vibration level of a block of samples."""
        return cls(_deviation(block.acceleration_m_s2), _deviation(block.rotation_rad_s))


def _deviation(samples: Array) -> float:
    return float(np.sqrt(np.mean((samples - samples.mean(axis=0)) ** 2))) if len(samples) else math.inf


class NotSettled(DeviceError):
    """The rig does not settle."""


class Settling:
    """Waits until the rig has settled. The level at rest is the lowest measured so far."""

    def __init__(self, imu: Imu | None, clock: Clock, timeouts: SettlingTimeouts | None = None) -> None:
        self.imu = imu
        self._clock = clock
        self._timeouts = timeouts or SettlingTimeouts()
        self._rest: VibrationLevel | None = None
        self._moved_s = clock.now_s()

    def moved(self) -> None:
        """Restart the wait: something has moved, or was touched."""
        self._moved_s = self._clock.now_s()

    def wait(self) -> VibrationLevel | None:
        """Wait, and give the vibration level, None without an IMU. Raises NotSettled, DeviceError."""
        left_s = self._moved_s + self._timeouts.decay_s - self._clock.now_s()
        if (self.imu is None or self._rest is None) and left_s > 0:
            self._clock.sleep(left_s)
        if self.imu is None:
            return None
        self.imu.start(self._timeouts.rate_hz)
        try:
            return self._until_settled(self.imu)
        finally:
            self.imu.stop()

    def _until_settled(self, imu: Imu) -> VibrationLevel:
        timeouts = self._timeouts
        end_s = self._clock.now_s() + timeouts.longest_s
        while True:
            level = VibrationLevel.of(imu.read_block(timeouts.window_s))
            self._rest = VibrationLevel(*map(min, level, self._rest or level))
            ratio = max(now / max(rest, 1e-9) for now, rest in zip(level, self._rest, strict=True))
            if ratio <= timeouts.factor:
                return level
            if self._clock.now_s() > end_s:
                raise NotSettled(
                    f"the rig must settle; after {timeouts.longest_s:g} s it still vibrates {ratio:.1f} times as much "
                    "as at rest",
                    "switch off the source of vibration, and do not touch the rig",
                )
