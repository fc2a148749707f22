"""Map from the sensor to the chart: subpixel x-corners, a homography, and a cubic for the lens distortion."""

from dataclasses import dataclass

import cv2
import numpy as np

from procedures.numerics.arrays import Array, Array32
from procedures.numerics.warps import CubicWarp, apply_homography, fit_homography, inverse
from procedures.pattern import BLOCK, CELLS, X_CORNERS


@dataclass(frozen=True)
class Registration(CubicWarp):
    """Map from pixels (x, y) of the plane to cells (x, y) of the chart; the marks fix its translation."""

    def to_pattern(self, points: Array) -> Array:
        """Cells (x, y) at points (n, 2) of the plane."""
        return self.forward(points)

    def to_sensor(self, cells: Array) -> Array:
        """Points (n, 2) of the plane at which cells (n, 2) are imaged."""
        return self.backward(cells)


def refine_corners(plane: Array32, corners: Array, block_px: float) -> Array:
    """Refine x-corners (n, 2) to subpixel accuracy, where the surrounding gradients are orthogonal to the rays.

    plane : (rows, columns) float32
    corners : (n, 2) initial positions (x, y), accurate to about a pixel; NaN rows stay
    block_px : side of a block of the chart's frame, in pixels: the window must stay inside the block

    Source: Delbracio, Muse, Almansa, IPOL 2012, section 4.2, equation (1).
    """
    half = max(2, int(0.25 * block_px))
    visible = np.isfinite(corners).all(axis=1)
    first = corners[visible].astype(np.float32).reshape(-1, 1, 2)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-5)
    refined_visible = cv2.cornerSubPix(plane, first.copy(), (half, half), (-1, -1), criteria)
    refined = np.full_like(corners, np.nan)
    refined[visible] = refined_visible.reshape(-1, 2)
    return refined


def register_marks(corners: Array) -> Registration:
    """Homography to the x-corners (12, 2), in the order of `pattern.X_CORNERS`, NaN where hidden, by least squares on
    the sensor."""
    visible = np.isfinite(corners).all(axis=1)
    H_sensor_pattern = fit_homography(X_CORNERS[visible], corners[visible])
    middle = np.array([[CELLS / 2, CELLS / 2]])
    rim = np.array([[0.0, 0.0], [CELLS, 0.0], [CELLS, CELLS], [0.0, CELLS]])
    centre = apply_homography(H_sensor_pattern, middle)[0]
    radius = float(np.linalg.norm(apply_homography(H_sensor_pattern, rim) - centre, axis=1).mean())
    return Registration(inverse(H_sensor_pattern), centre, radius, np.zeros((2, 9)))


def mark_residuals(registration: Registration, corners: Array) -> Array:
    """Offsets (n, 2), in pixels, of the visible marks from their mapped positions."""
    visible = np.isfinite(corners).all(axis=1)
    return np.asarray(corners[visible] - registration.to_sensor(X_CORNERS[visible]))


def map_distance(a: Registration, b: Registration, points: Array) -> float:
    """Largest distance, in pixels, between two maps of the cells that `b` has at points (n, 2)."""
    cells = a.to_pattern(points) - b.to_pattern(points)
    return float(np.abs(cells @ inverse(b.jacobian()).T).max())


def block_size_px(registration: Registration) -> float:
    """Side of a block of the chart's frame, in pixels, at the chart's centre."""
    return float(BLOCK / np.sqrt(abs(np.linalg.det(registration.jacobian()))))
