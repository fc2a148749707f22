"""Records of the camera's motion during an exposure: measured by an inertial unit, or commanded to a shaker."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, eq=False)
class ImuRecord:
    """Samples of an inertial unit on the camera around an exposure, its x to the right, its y up.

    time_s : (n,) from the opening of the shutter; acceleration_m_s2, rotation_rad_s : (n, 3), gravity included.
    """

    time_s: npt.NDArray[np.float64]
    acceleration_m_s2: npt.NDArray[np.float64]
    rotation_rad_s: npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ShakerPath:
    """The closed path around which a shaker was commanded to move the camera during an exposure.

    position_m : (n, 3) of one round, x to the right, y up, z back, relative to the rest position
    interval_s : between two positions
    since_s : from the first position to the opening of the shutter; None where that was not recorded
    """

    position_m: npt.NDArray[np.float64]
    interval_s: float
    since_s: float | None = None
