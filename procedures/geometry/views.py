"""What the geometry is computed from: a chart's nodes, and where each photograph shows them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from procedures.pattern import CELLS
from procedures.pattern_psf.correspondences import bin_centres

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ChartView:
    """One photograph of the chart.

    Attributes
    ----------
    source : str
        What it is called.
    index : (n,) int64
        Which of the chart's nodes are seen.
    points : (n, 2) float64
        Where, (x, y) in sensor pixels with centres at integers.
    covariance : (n, 2, 2) float64
        Of each point, in squared pixels; those of different points are independent.
    """

    source: str
    index: npt.NDArray[np.int64]
    points: Array
    covariance: Array

    def __len__(self) -> int:
        """Number of nodes seen."""
        return len(self.index)

    @cached_property
    def whitening(self) -> Array:
        """W (n, 2, 2) with W C W' = 1: what turns pixels into standard deviations."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.covariance)), dtype=np.float64)


def greatest_tilt(nodes: Array, views: Sequence[ChartView]) -> float:
    """How far a chart's plane is turned away from the sensor's at the most, in degrees, as its foreshortening tells.

    Needs no camera: a plane that stands square to the lens is seen with one scale in all directions, wherever it
    appears. Distortion by some per cent looks like 15 degrees.
    """
    ratios = []
    for view in views:
        flat = nodes[view.index, :2] - nodes[view.index, :2].mean(axis=0)
        scales = np.linalg.svd(np.linalg.lstsq(flat, view.points - view.points.mean(axis=0), rcond=None)[0])[1]
        ratios.append(scales[1] / scales[0])
    return float(np.degrees(np.arccos(min(ratios, default=1.0))))


@dataclass(frozen=True)
class Pose:
    """Where the chart stands before the camera: X_camera = R X_chart + t.

    Attributes
    ----------
    R : (3, 3) float64
        Its columns are the chart's right, down and away as the camera sees them (x right, y down, z away).
    t : (3,) float64
        The chart's centre in the camera's frame, in mm.
    """

    R: Array
    t: Array

    def apply(self, points: Array) -> Array:
        """Points (n, 3) of the chart in the camera's frame."""
        return np.asarray(points @ self.R.T + self.t)


def chart_nodes(cell_mm: float) -> Array:
    """The centres of the chart's bins in mm from its centre, on a flat sheet, (N, 3).

    Parameters
    ----------
    cell_mm : float
        Side of a printed cell.
    """
    flat = (bin_centres() - CELLS / 2) * cell_mm
    return np.column_stack([flat, np.zeros(len(flat))])
