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

Indices = npt.NDArray[np.int64]

# Gauss-Legendre, exact to degree 3: along a piece the hat is linear in y and its integral quadratic in x
_NODES = (0.5 - 0.5 / 3**0.5, 0.5 + 0.5 / 3**0.5)


@dataclass(frozen=True, eq=False)
class Segments:
    """Directed, weighted segments: starts and ends are points (x, y), (n, 2); weights (n,)."""

    starts: Array
    ends: Array
    weights: Array

    def where(self, keep: npt.NDArray[np.bool_]) -> Segments:
        """The selected segments."""
        return Segments(self.starts[keep], self.ends[keep], self.weights[keep])

    def moved(self, x: float, y: float) -> Segments:
        """The segments relative to (x, y)."""
        return Segments(self.starts - (x, y), self.ends - (x, y), self.weights)

    def inside(self, low: float, high: float) -> Segments:
        """Segments that pass y from `low` to `high`; the others enclose nothing there."""
        y0, y1 = self.starts[:, 1], self.ends[:, 1]
        return self.where((np.maximum(y0, y1) > low) & (np.minimum(y0, y1) < high) & (y0 != y1))

    def cut(self, axis: int) -> Segments:
        """The segments cut where their coordinate `axis` (0 = x, 1 = y) is an integer."""
        source, first, last = _pieces(self.starts[:, axis], self.ends[:, axis])
        start, step = self.starts[source], (self.ends - self.starts)[source]
        return Segments(start + first[:, None] * step, start + last[:, None] * step, self.weights[source])


def outline(vertices: Array) -> Segments:
    """The closed outline of a simple polygon (n, 2), directed so that its inside adds 1."""
    ends = np.roll(vertices, -1, axis=0)
    twice_area = np.sum(vertices[:, 0] * ends[:, 1] - ends[:, 0] * vertices[:, 1])
    # with y down a positive area is walked clockwise as seen, its left side upwards
    return Segments(vertices, ends, np.full(len(vertices), -np.sign(twice_area)))


def coverage(segments: Segments, shape: tuple[int, int]) -> Array:
    """Area enclosed by the segments, averaged under a hat at integer x and y, exact to rounding.

    Sample (row i, column j) is the integral of the enclosed weight times (1 - |x - j|) (1 - |y - i|), (rows, columns).
    """
    rows, columns = shape
    pieces = segments.inside(-1, rows).cut(axis=1)
    # assign pieces by their midpoint: their rounded ends may lie slightly outside the grid
    middle = (pieces.starts + pieces.ends) / 2
    pieces = pieces.where((middle[:, 1] > -1) & (middle[:, 1] < rows))
    low = np.minimum(pieces.starts[:, 0], pieces.ends[:, 0])
    left = np.maximum(pieces.starts[:, 0], pieces.ends[:, 0]) <= -1
    near = pieces.where(~left & (low < columns)).cut(axis=0)
    spreads = [_spread(some, shape) for some in (near, pieces.where(left))]
    where, what = (np.concatenate([spread[i].ravel() for spread in spreads]) for i in (0, 1))
    width = columns + 1
    # float64 also without any piece; summed in place, as such an image is large
    steps = np.bincount(where, what, (rows + 2) * width).astype(np.float64, copy=False)
    inside = steps.reshape(rows + 2, width)[1:-1]
    return np.cumsum(inside, axis=1, out=inside)[:, :columns]


def _spread(pieces: Segments, shape: tuple[int, int]) -> tuple[Indices, Array]:
    """Contributions of each piece to the steps along x between samples, as flat indices and values, (2, 3, n) each.

    Along y a piece overlaps the hats of two samples; along x a step between two samples is the difference of hats,
    whose integral is the quadratic B-spline, which overlaps three. One row on either side and one column on the right
    are spare.
    """
    rows, columns = shape
    (x0, y0), (x1, y1) = pieces.starts.T, pieces.ends.T
    column, row = np.floor((x0 + x1) / 2), np.floor((y0 + y1) / 2)
    half = pieces.weights * (y1 - y0) / 2
    what = np.zeros((2, 3, len(half)))
    for node in _NODES:
        t, u = x0 + node * (x1 - x0) - column, y0 + node * (y1 - y0) - row
        for changes, across in zip(what, (half * (1 - u), half * u), strict=True):
            changes[0] += across * ((1 - t) ** 2 / 2)
            changes[1] += across * (0.75 - (t - 0.5) ** 2)
            changes[2] += across * (t**2 / 2)
    i, j = row.astype(np.int64), column.astype(np.int64)
    place_x = np.clip(j + np.arange(3)[:, None], 0, columns)
    place_y = np.clip(i + 1 + np.arange(2)[:, None], 0, rows + 1)
    return place_y[:, None] * (columns + 1) + place_x, what


def _pieces(a0: Array, a1: Array) -> tuple[Indices, Array, Array]:
    """For segments from a0 to a1: source, and first and last parameter in [0, 1], of the pieces between integers."""
    low = np.floor(np.minimum(a0, a1))
    count = np.maximum(np.ceil(np.maximum(a0, a1)) - low, 1).astype(np.int64)
    source = np.repeat(np.arange(len(a0)), count)
    line = low[source] + np.arange(len(source)) - np.repeat(np.cumsum(count) - count, count)
    run = (a1 - a0)[source]
    level = run == 0
    scale = np.where(level, 1.0, run)
    first, second = ((np.clip((line + step - a0[source]) / scale, 0, 1)) for step in (0, 1))
    return source, np.where(level, 0.0, np.minimum(first, second)), np.where(level, 1.0, np.maximum(first, second))


Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class ObjectPose:
    """Position and orientation of a flat object.

    centre_mm : (x, y, z) its centre; z is the distance from the lens along the optical axis
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


@dataclass(frozen=True)
class Projection:
    """A pinhole with radial distortion.

    principal_px : float, distance from the pinhole to the sensor, in sensor pixels
    centre : (x, y) intersection of the optical axis with the sensor, in sensor pixels
    k1, k2 : float, a point at distance r from the axis appears at r (1 + k1 q^2 + k2 q^4), q = r / radius_px
    radius_px : float, reference distance of k1 and k2: half the frame's diagonal
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

    Raises ValueError if the object is not beyond the focal length.
    """
    if focus_mm <= focal_length_mm:
        raise ValueError(f"a lens of {focal_length_mm} mm must focus beyond its focal length; got {focus_mm} mm")
    return focal_length_mm * focus_mm / (focus_mm - focal_length_mm)
