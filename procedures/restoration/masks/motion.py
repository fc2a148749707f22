"""From the motion of the camera during the exposure to the blur it makes (chapter 5, section 6.7).

Image coordinates and translations are in units of the focal length, as in (5.1), x right, y down, z ahead.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from procedures.outcome import BadInput

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """Velocities of the camera during the exposure.

    time_s : (n,) increasing; translation_m_s : (n, 3) T; rotation_rad_s : (n, 3) Omega.

    Raises
    ------
    BadInput
        If the samples are fewer than two, do not agree in number, or time does not increase.
    """

    time_s: Array
    translation_m_s: Array
    rotation_rad_s: Array

    def __post_init__(self) -> None:
        n = len(self.time_s)
        if n < 2 or self.translation_m_s.shape != (n, 3) or self.rotation_rad_s.shape != (n, 3):
            raise BadInput(f"motion needs two samples or more, three components each; got {n}", "record the exposure")
        if not (np.diff(self.time_s) > 0).all():
            raise BadInput("times of the motion must increase", "sort the record, drop repeated samples")


def velocity_field(x: float, y: float, depth_m: float | Array, T: Array, Omega: Array) -> Array:
    """Apparent velocity of the image point (x, y), focal lengths per second, (n, 2): equation (5.1)."""
    Tx, Ty, Tz = T.T
    wx, wy, wz = Omega.T
    across = (-Tx + x * Tz) / depth_m + x * y * wx - (1 + x**2) * wy + y * wz
    down = (-Ty + y * Tz) / depth_m + (1 + y**2) * wx - x * y * wy - x * wz
    return np.stack([across, down], axis=1)


@dataclass(frozen=True)
class Exposure:
    """One exposure within a record of the camera's motion: from, until, and when the depth map is right, seconds.

    The depth map belongs to one time for all photographs. Curves that begin there contain the displacement between the
    photographs, pixel by pixel, so that the depth map need not be carried into each of them.
    """

    start_s: float
    end_s: float
    reference_s: float


def curve(
    motion: Motion, x: float, y: float, depth_m: float, steps: int = 512, exposure: Exposure | None = None
) -> Array:
    """Apparent curve drawn by the point (x, y) of depth l at the time of reference, (n, 2), focal lengths.

    The point moves while it is drawn, so the velocity is taken where it is: midpoint rule from the reference both ways.
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


def path_mask(path_px: Array, R: int, *, softness_px: float = 0.3) -> Array:
    """Mask (2R + 1, 2R + 1), sum 1, of a curve (n, 2) in pixels about its own point: equation (5.2).

    Each instant is shared linearly between its four pixels, then spread by the pixel's own `softness_px`.

    Raises
    ------
    BadInput
        If the curve leaves the mask.
    """
    if np.abs(path_px).max() > R - 1:
        raise BadInput(
            f"the motion of {np.abs(path_px).max():.1f} pixels leaves masks of half-size {R}", "raise --max-w"
        )
    out = np.zeros((2 * R + 1, 2 * R + 1))
    x, y = path_px[:, 0] + R, path_px[:, 1] + R
    i, j = np.floor(y).astype(int), np.floor(x).astype(int)
    fy, fx = y - i, x - j
    for di, wy in ((0, 1 - fy), (1, fy)):
        for dj, wx in ((0, 1 - fx), (1, fx)):
            np.add.at(out, (i + di, j + dj), wy * wx)
    out = gaussian_filter(out, softness_px, mode="constant")
    return np.asarray(out / out.sum())
