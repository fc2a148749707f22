"""What is known of the camera's motion during an exposure: felt by an inertial unit, or commanded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, eq=False)
class Felt:
    """What an inertial unit on the camera felt about an exposure, its x to the right, its y up.

    time_s : (n,) from the opening of the shutter on; acceleration_m_s2, rotation_rad_s : (n, 3), gravity included.
    """

    time_s: npt.NDArray[np.float64]
    acceleration_m_s2: npt.NDArray[np.float64]
    rotation_rad_s: npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Carried:
    """The closed path around which a shaker was told to carry the camera during an exposure.

    position_m : (n, 3) of one round, x to the right, y up, z back, from where it rests
    interval_s : between them
    since_s : from the first of them to the opening of the shutter; None where nobody told
    """

    position_m: npt.NDArray[np.float64]
    interval_s: float
    since_s: float | None = None
