"""Outlines of the chart's sheet for the preview: as it is, and as it is wanted."""

import numpy as np

from procedures.numerics.arrays import Array
from procedures.numerics.warps import apply_homography
from procedures.pattern import CELLS
from procedures.plan import Points

SHEET = 1.3  # side of the chart with its marks and a white rim, over that of its noise region
CORNERS: Array = CELLS / 2 * (1 + SHEET * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=np.float64))
"""The sheet's corners in cells, from the upper left clockwise."""


def points_of(corners: Array) -> Points:
    """An array (n, 2) as points."""
    return tuple((float(x), float(y)) for x, y in corners)


def present_outline(H_sensor_pattern: Array) -> Points:
    """The sheet's corners in pixels of the plane."""
    return points_of(apply_homography(H_sensor_pattern, CORNERS))


def frontal_outline(shape: tuple[int, ...], px_per_cell: float, at: tuple[float, float] = (0.5, 0.5)) -> Points:
    """The upright sheet of that size with its centre `at` a place, in fractions of the frame."""
    centre = np.array([at[0] * shape[1], at[1] * shape[0]]) - 0.5
    return points_of(centre + px_per_cell * (CORNERS - CELLS / 2))
