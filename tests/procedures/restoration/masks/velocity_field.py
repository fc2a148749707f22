"""Curves of any camera motion, integrated step by step from the velocity field (5.1), as a reference for poses.

Image coordinates and translations are in units of the focal length, as in (5.1), x right, y down, z ahead.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """Velocities of the camera during the exposure.

    time_s : (n,) increasing; translation_m_s : (n, 3) T; rotation_rad_s : (n, 3) Omega.
    """

    time_s: Array
    translation_m_s: Array
    rotation_rad_s: Array


def velocity_field(x: float, y: float, depth_m: float | Array, T: Array, Omega: Array) -> Array:
    """Apparent velocity of the image point (x, y), focal lengths per second, (n, 2): equation (5.1)."""
    Tx, Ty, Tz = T.T
    wx, wy, wz = Omega.T
    across = (-Tx + x * Tz) / depth_m + x * y * wx - (1 + x**2) * wy + y * wz
    down = (-Ty + y * Tz) / depth_m + (1 + y**2) * wx - x * y * wy - x * wz
    return np.stack([across, down], axis=1)


@dataclass(frozen=True)
class Exposure:
    """One exposure within a record of the camera's motion: start, end, and time of the depth map, seconds.

    The depth map refers to one time for all photographs. Curves that start there contain the displacement between the
    photographs, pixel by pixel, so that the depth map need not be transformed to each of them.
    """

    start_s: float
    end_s: float
    reference_s: float


def curve(
    motion: Motion, x: float, y: float, depth_m: float, steps: int = 512, exposure: Exposure | None = None
) -> Array:
    """Apparent curve drawn by the point (x, y) of depth l at the time of reference, (n, 2), focal lengths.

    The point moves during the exposure, so the velocity is taken at its current position: midpoint rule, both ways.
    Without `exposure` the whole record is the exposure and its middle the reference.
    """
    times = np.linspace(motion.time_s[0], motion.time_s[-1], steps)
    T = np.stack([np.interp(times, motion.time_s, motion.translation_m_s[:, k]) for k in range(3)], axis=1)
    Omega = np.stack([np.interp(times, motion.time_s, motion.rotation_rad_s[:, k]) for k in range(3)], axis=1)
    places = np.empty((steps, 2))
    begin = steps // 2 if exposure is None else int(np.argmin(np.abs(times - exposure.reference_s)))
    dt = times[1] - times[0]
    for direction in (1, -1):
        at, depth = np.array([x, y]), depth_m
        places[begin] = at
        for k in range(begin + direction, steps if direction > 0 else -1, direction):
            t, o = (T[k] + T[k - direction]) / 2, (Omega[k] + Omega[k - direction]) / 2
            half = at + direction * dt / 2 * velocity_field(at[0], at[1], depth, t[None], o[None])[0]
            at = at + direction * dt * velocity_field(half[0], half[1], depth, t[None], o[None])[0]
            depth = depth - direction * dt * t[2]
            places[k] = at
    if exposure is None:
        return places
    return places[(times >= exposure.start_s) & (times <= exposure.end_s)]
