"""Projection of points in space onto the sensor: pose, pinhole, radial distortion.

Space is in millimetres in the camera's frame: x to the right, y down, z away from the camera. The sensor is in sensor
pixels (x, y) with pixel centres at integers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class ObjectPose:
    """Position and orientation of a flat object.

    Attributes
    ----------
    centre_mm : (x, y, z)
        Its centre; z is the distance from the lens along the optical axis.
    yaw_deg, pitch_deg, roll_deg : float
        Rotations about its vertical, its horizontal and its normal: roll is applied last and turns x towards y.
    """

    centre_mm: tuple[float, float, float]
    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    roll_deg: float = 0.0

    def __post_init__(self) -> None:
        if self.centre_mm[2] <= 0:
            raise ValueError(f"the scene must be in front of the camera, z > 0; got {self.centre_mm[2]} mm")

    @property
    def axes(self) -> Array:
        """The object's x and y axes and its normal in the camera's frame, as columns, (3, 3)."""
        turn = Rotation.from_euler("ZYX", [self.roll_deg, self.yaw_deg, self.pitch_deg], degrees=True)
        return np.asarray(turn.as_matrix(), dtype=np.float64)

    def plane_to_space(self) -> Array:
        """Matrix from points (x_mm, y_mm, 1) of the object's plane, relative to its centre, to space in mm, (3, 3)."""
        return np.column_stack([self.axes[:, 0], self.axes[:, 1], self.centre_mm])


class Placed(Protocol):
    """A flat object in space."""

    @property
    def pose(self) -> ObjectPose:
        """Pose of its centre and plane."""
        ...


@dataclass(frozen=True)
class Projection:
    """A pinhole with radial distortion.

    Attributes
    ----------
    principal_px : float
        Distance from the pinhole to the sensor, in sensor pixels.
    centre : (x, y)
        Intersection of the optical axis with the sensor, in sensor pixels.
    k1, k2 : float
        A point at distance r from the axis appears at r (1 + k1 q^2 + k2 q^4), q = r / radius_px.
    radius_px : float
        Reference distance of k1 and k2: half the frame's diagonal.
    """

    principal_px: float
    centre: tuple[float, float]
    k1: float = 0.0
    k2: float = 0.0
    radius_px: float = 1.0

    def pinhole(self) -> Array:
        """Matrix from points (x, y, z) of space to homogeneous sensor points without distortion, (3, 3)."""
        F, (cx, cy) = self.principal_px, self.centre
        return np.array([[F, 0.0, cx], [0.0, F, cy], [0.0, 0.0, 1.0]])

    def distort(self, points: Array) -> Array:
        """Map sensor points (n, 2) of the ideal pinhole to distorted ones, (n, 2)."""
        if self.k1 == 0 and self.k2 == 0:
            return points
        offset = points - np.array(self.centre)
        q2 = np.sum(offset**2, axis=-1, keepdims=True) / self.radius_px**2
        drawn: Array = np.array(self.centre) + offset * (1 + self.k1 * q2 + self.k2 * q2**2)
        return drawn


def apply_homography(H: Array, points: Array) -> Array:
    """Map points (n, 2) by a homography (3, 3), (n, 2)."""
    homogeneous = points @ H[:, :2].T + H[:, 2]
    return np.asarray(homogeneous[:, :2] / homogeneous[:, 2:], dtype=np.float64)


def image_distance_mm(focal_length_mm: float, focus_mm: float) -> float:
    """Distance behind a thin lens at which an object at `focus_mm` is sharp, in mm.

    Raises
    ------
    ValueError
        If the object is not beyond the focal length.
    """
    if focus_mm <= focal_length_mm:
        raise ValueError(f"a lens of {focal_length_mm} mm must focus beyond its focal length; got {focus_mm} mm")
    return focal_length_mm * focus_mm / (focus_mm - focal_length_mm)
