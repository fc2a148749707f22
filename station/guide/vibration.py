"""When the rig is still: told by the IMU against its own noise at rest, or waited for where there is none."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from drivers.clock import Clock
from drivers.errors import DeviceError
from drivers.interfaces import Imu, ImuBlock

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class SettlingTimeouts:
    """How long to wait, and what counts as still.

    Attributes
    ----------
    frequency_hz, damping : float
        Of the stage's slowest mode; without an IMU it is given the time to decay to `quiet` of what shook it.
    rate_hz, window_s : float
        How the IMU is asked.
    factor : float
        Still is up to this many times the noise at rest. The root mean square of 40 samples of three axes scatters by
        6 %: 1.4 is more than six deviations of that.
    longest_s : float
        After this long it is said that the rig does not come to rest.
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
        """Time in which the slowest mode becomes quiet: exp(-2 pi damping frequency t) = quiet."""
        return -math.log(self.quiet) / (2 * math.pi * self.damping * self.frequency_hz)


@dataclass(frozen=True)
class VibrationLevel:
    """Root mean square of acceleration in m/s^2 and rotation rate in rad/s about their means."""

    acceleration_m_s2: float
    rotation_rad_s: float

    @classmethod
    def of(cls, block: ImuBlock) -> VibrationLevel:
        """Of the samples of one block."""
        return cls(_scatter(block.acceleration_m_s2), _scatter(block.rotation_rad_s))

    def over(self, rest: VibrationLevel) -> float:
        """How many times the tremor at rest this is, by whichever sensor tells more."""
        return max(
            self.acceleration_m_s2 / max(rest.acceleration_m_s2, 1e-9),
            self.rotation_rad_s / max(rest.rotation_rad_s, 1e-9),
        )

    def least(self, other: VibrationLevel) -> VibrationLevel:
        """The quieter of two, sensor by sensor."""
        return VibrationLevel(
            min(self.acceleration_m_s2, other.acceleration_m_s2), min(self.rotation_rad_s, other.rotation_rad_s)
        )


def _scatter(samples: Array) -> float:
    return float(np.sqrt(np.mean((samples - samples.mean(axis=0)) ** 2))) if len(samples) else math.inf


class NotSettled(DeviceError):
    """The rig does not come to rest."""


class Settling:
    """Waits until the rig is still. What is at rest is learnt on the way: the quietest that was ever seen."""

    def __init__(self, imu: Imu | None, clock: Clock, patience: SettlingTimeouts | None = None) -> None:
        self.imu = imu
        self._clock = clock
        self._patience = patience or SettlingTimeouts()
        self._rest: VibrationLevel | None = None
        self._moved_s = clock.now_s()

    def moved(self) -> None:
        """Something has just moved, or was touched."""
        self._moved_s = self._clock.now_s()

    def wait(self) -> VibrationLevel | None:
        """Return when still: the tremor, None where no IMU tells it. Raises Unrest, DeviceError."""
        if self.imu is None or self._rest is None:
            self._decay()
        if self.imu is None:
            return None
        self.imu.start(self._patience.rate_hz)
        try:
            return self._until_still(self.imu)
        finally:
            self.imu.stop()

    def _decay(self) -> None:
        left_s = self._moved_s + self._patience.decay_s - self._clock.now_s()
        if left_s > 0:
            self._clock.sleep(left_s)

    def _until_still(self, imu: Imu) -> VibrationLevel:
        patience = self._patience
        end_s = self._clock.now_s() + patience.longest_s
        while True:
            tremor = VibrationLevel.of(imu.read_block(patience.window_s))
            self._rest = tremor if self._rest is None else self._rest.least(tremor)
            times = tremor.over(self._rest)
            if times <= patience.factor:
                return tremor
            if self._clock.now_s() > end_s:
                raise NotSettled(
                    f"the rig does not come to rest: it trembles {times:.1f} times as much as at rest, after "
                    f"{patience.longest_s:g} s",
                    "switch off what shakes it and touch nothing",
                )
