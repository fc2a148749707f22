"""Pose of the chart: distance, position and orientation, from its homography and the lens.

Source: Zhang, A flexible new technique for camera calibration, PAMI 2000, section 3.1: K^-1 H = (r1 r2 t).
"""

from dataclasses import dataclass

import numpy as np

from procedures.numerics.arrays import Array
from procedures.numerics.warps import homography_jacobian
from procedures.pattern import CELLS


@dataclass(frozen=True)
class ImagingGeometry:
    """Data of camera and print that relate sizes to distances.

    plane_pitch_um : distance of the plane's pixels on the sensor (twice the photosites' in a Bayer plane); cell_mm :
    side of a printed cell.
    """

    focal_length_mm: float
    plane_pitch_um: float
    cell_mm: float

    def distance_mm(self, px_per_cell: float) -> float:
        """Distance from the lens of a frontal chart in focus with `px_per_cell` pixels per cell.

        A thin lens focused at z has the image distance F = f z / (z - f): px = F cell / (z pitch) = f cell / ((z - f)
        pitch).
        """
        return self.focal_length_mm * (1 + self.cell_mm / (px_per_cell * self.plane_pitch_um / 1000))

    def principal_px(self, distance_mm: float) -> float:
        """Image distance for a focus distance, in pixels of the plane."""
        f = self.focal_length_mm
        return 1000 * f * distance_mm / (distance_mm - f) / self.plane_pitch_um


@dataclass(frozen=True)
class ChartPose:
    """Pose of the chart in the camera's frame: x right, y down, z away from the camera.

    centre_mm : (x, y, z)
    yaw_deg : positive if the chart's right edge is nearer
    pitch_deg : positive if its lower edge is farther
    roll_deg : positive if it is turned clockwise
    """

    centre_mm: tuple[float, float, float]
    yaw_deg: float
    pitch_deg: float
    roll_deg: float


def chart_pose(H_plane_cells: Array, shape: tuple[int, ...], optics: ImagingGeometry) -> ChartPose:
    """Compute the pose from a homography from cells to the plane's pixels.

    H_plane_cells : (3, 3) float64
    shape : (rows, columns) of the plane; its centre is assumed to be the principal point
    """
    middle = CELLS / 2
    to_cells = np.array([[1 / optics.cell_mm, 0, middle], [0, 1 / optics.cell_mm, middle], [0, 0, 1]])
    # pixels per cell at the chart's centre, along the direction without foreshortening
    px_per_cell = float(np.linalg.norm(homography_jacobian(H_plane_cells, np.full(2, CELLS / 2)), 2))
    F = optics.principal_px(optics.distance_mm(px_per_cell))
    K = np.array([[F, 0, (shape[1] - 1) / 2], [0, F, (shape[0] - 1) / 2], [0, 0, 1]])
    M = np.linalg.solve(K, H_plane_cells @ to_cells)
    M = M / np.sqrt(np.linalg.norm(M[:, 0]) * np.linalg.norm(M[:, 1]))
    M = M if M[2, 2] > 0 else -M
    # rotation whose first two columns are nearest to a and b
    a = M[:, 0]
    b = M[:, 1]
    U, _, Vt = np.linalg.svd(np.column_stack([a, b, np.cross(a, b)]))
    R = np.asarray(U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt)
    # R = Rz(roll) Ry(yaw) Rx(pitch)
    yaw, pitch, roll = -np.arcsin(R[2, 0]), np.arctan2(R[2, 1], R[2, 2]), np.arctan2(R[1, 0], R[0, 0])
    x, y, z = (float(part) for part in M[:, 2])
    return ChartPose((x, y, z), *(float(np.degrees(angle)) for angle in (yaw, pitch, roll)))
