"""Input of the calibration: the nodes of a chart, and their positions in each photograph."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from procedures.numerics.arrays import Array, Indices, Mask
from procedures.pattern import CELLS
from procedures.pattern_psf.correspondences import bin_centres


@dataclass(frozen=True, eq=False)
class ChartView:
    """One photograph of the chart.

    source : str, name of the photograph
    index : (n,) int64, indices of the visible nodes
    points : (n, 2) float64, their positions (x, y) in sensor pixels with centres at integers
    covariance : (n, 2, 2) float64, of each point, in squared pixels; different points are independent
    camera : int, which of several cameras took it
    time_s : float, time of the middle row's exposure, for frames of a video
    """

    source: str
    index: Indices
    points: Array
    covariance: Array
    camera: int = 0
    time_s: float = 0.0

    def __len__(self) -> int:
        """Number of points."""
        return len(self.index)

    def part(self, chosen: Mask) -> "ChartView":
        """The view with some of its points."""
        return replace(self, index=self.index[chosen], points=self.points[chosen], covariance=self.covariance[chosen])

    @cached_property
    def whitening(self) -> Array:
        """W (n, 2, 2) with W C W' = 1: from pixels to standard deviations."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.covariance)), dtype=np.float64)


def greatest_tilt(nodes: Array, views: Sequence[ChartView]) -> float:
    """Largest angle between chart and sensor plane, in degrees, from the foreshortening.

    No camera is required: a frontal plane has the same scale in all directions, wherever it appears. Distortion of
    several per cent appears as 15 degrees.
    """
    ratios = []
    for view in views:
        flat = nodes[view.index, :2] - nodes[view.index, :2].mean(axis=0)
        scales = np.linalg.svd(np.linalg.lstsq(flat, view.points - view.points.mean(axis=0), rcond=None)[0])[1]
        ratios.append(scales[1] / scales[0])
    return float(np.degrees(np.arccos(min(ratios, default=1.0))))


@dataclass(frozen=True)
class Pose:
    """Pose of the chart in the camera's frame: X_camera = R X_chart + t.

    R : (3, 3) float64, its columns are the chart's right, down and away in the camera's frame (x right, y down, z away)
    t : (3,) float64, the chart's centre in the camera's frame, in mm
    """

    R: Array
    t: Array

    def apply(self, points: Array) -> Array:
        """Points (n, 3) of the chart in the camera's frame."""
        return np.asarray(points @ self.R.T + self.t)


def normals_spread_deg(poses: Sequence[Pose]) -> float:
    """Greatest angle between the charts' normals and their mean."""
    normals = np.array([pose.R[:, 2] for pose in poses])
    mean = normals.mean(axis=0)
    return float(np.degrees(np.arccos(np.clip(normals @ mean / np.linalg.norm(mean), -1, 1)).max()))


def chart_nodes(cell_mm: float) -> Array:
    """Centres of the chart's bins on a flat sheet, in mm from its centre, (N, 3).

    cell_mm : float, side of a printed cell
    """
    flat = (bin_centres() - CELLS / 2) * cell_mm
    return np.column_stack([flat, np.zeros(len(flat))])
