"""Records of the camera's motion during an exposure: measured by an inertial unit, or commanded to a shaker."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, eq=False)
class ImuRecord:
    """Samples of an inertial unit on the camera around an exposure, its x to the right, its y up.

    time_s : (n,) from the opening of the shutter; acceleration_m_s2, rotation_rad_s : (n, 3), gravity included.
    within_s : bound of the common error of all times.
    """

    time_s: npt.NDArray[np.float64]
    acceleration_m_s2: npt.NDArray[np.float64]
    rotation_rad_s: npt.NDArray[np.float64]
    within_s: float = 0.0


@dataclass(frozen=True)
class ShakerResponse:
    """How an axis follows its command: gain, resonance in Hz (None: at any frequency), damping ratio."""

    gain: float = 1.0
    frequency_hz: float | None = None
    damping: float = 1.0

    def at(self, frequency_hz: npt.NDArray[np.float64]) -> npt.NDArray[np.complex128]:
        """Amplitude and phase at some frequencies: of a mass on a damped spring."""
        if self.frequency_hz is None:
            return np.full(frequency_hz.shape, self.gain, np.complex128)
        ratio = frequency_hz / self.frequency_hz
        return np.asarray(self.gain / (1 - ratio**2 + 2j * self.damping * ratio))


@dataclass(frozen=True, eq=False)
class ShakerPath:
    """The closed path around which a shaker was commanded to move the camera during an exposure.

    position_m : (n, 3) of one round, x to the right, y up, z back, relative to the rest position
    interval_s : between two positions
    since_s : from the first position to the opening of the shutter; None where that was not recorded
    response : of the three axes to their commands
    within_s : bound of the common error of all times
    """

    position_m: npt.NDArray[np.float64]
    interval_s: float
    since_s: float | None = None
    response: tuple[ShakerResponse, ...] = (ShakerResponse(),) * 3
    within_s: float = 0.0
