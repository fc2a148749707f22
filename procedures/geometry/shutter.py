"""Row time of a rolling shutter, from frames of a video in which the chart or the camera moves.

A row y is exposed y times the row time r after the first, so that a point at row y appears where the moving chart is
at that time. A cubic spline through the poses over time gives the velocity V of every view, a rotation and a shift per
second; to first order a point is displaced by

    r (y - y0) J V,

J being the derivative of the projection by the pose, and y0 the middle row, to whose time the poses refer. The
points are corrected for this displacement, and r is an unknown of the adjustment in addition to all others.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from procedures.geometry.adjustment import (
    Adjustment,
    AdjustmentProblem,
    AdjustmentState,
    ModelDoubt,
    adjust,
    by_pose,
    extra_terms,
)
from procedures.geometry.views import ChartView, Pose
from procedures.outcome import Refused

Array = npt.NDArray[np.float64]

FEWEST_FRAMES = 6
"""Frames of a video that show how the chart moves."""
ITERATIONS, NEGLIGIBLE = 6, 0.05
"""Corrections of the points at most; change of the row time, in standard uncertainties, that needs no further one."""
SIGNIFICANT = 3.0
"""Row time, in standard uncertainties, from which the shutter is a rolling one."""
SHARP_S = 1e-3
"""Uncertainty of the readout time up to which a shutter without a significant row time is a global one."""
ENDS = 1
"""Views at either end of a video, whose velocity a spline does not give well: they do not contribute."""


@dataclass(frozen=True)
class ShutterTiming:
    """Row time of a camera.

    row_s, uncertainty_s : float
        Time between the exposures of neighbouring rows; positive where lower rows are later.
    rows : int
    """

    row_s: float
    uncertainty_s: float
    rows: int

    @property
    def kind(self) -> str:
        """ "rolling", "global", or "undetermined" where the views moved too little to show it."""
        if abs(self.row_s) > SIGNIFICANT * self.uncertainty_s:
            return "rolling"
        return "global" if self.uncertainty_s * self.rows < SHARP_S else "undetermined"

    @property
    def words(self) -> str:
        """The kind with the readout time."""
        readout, sigma = (1e3 * self.rows * one for one in (self.row_s, self.uncertainty_s))
        return {
            "rolling": f"rolling shutter, {abs(readout):.3g} ms for {self.rows} rows, "
            + ("the first row first" if readout > 0 else "the last row first"),
            "global": f"global shutter, all rows within {2 * sigma:.2g} ms",
            "undetermined": f"shutter undetermined to {sigma:.2g} ms, since the chart moved too little or too slowly",
        }[self.kind]


def find_shutter(state: AdjustmentState, problem: AdjustmentProblem) -> tuple[ShutterTiming, AdjustmentProblem]:
    """The row time by a simple camera, and the problem with points corrected to the middle row's time.

    Raises Refused if the views are too few to show how the chart moves.
    """
    if len(problem.views) < FEWEST_FRAMES:
        raise Refused(
            f"the row time of a shutter needs {FEWEST_FRAMES} frames that show the chart; there are "
            f"{len(problem.views)}",
            "record a longer video, or omit --frame-rate-hz",
        )
    original, total = problem.views, 0.0
    for _ in range(ITERATIONS):
        fit = adjust(state, problem)
        change, sigma, _ = row_time(fit)
        total, state = total + change, fit.state
        problem = replace(problem, views=_corrected(fit, original, total))
        if abs(change) < NEGLIGIBLE * sigma:
            break
    return ShutterTiming(total, sigma, state.camera.rows), problem


def with_row_time(fit: Adjustment, first: ShutterTiming) -> tuple[ShutterTiming, Adjustment]:
    """The row time by the final camera, and the adjustment with its uncertainty among the doubts."""
    change, sigma, response = row_time(fit)
    row = (sigma * response)[None]
    doubt = fit.doubt or ModelDoubt(np.zeros((0, len(response))), np.zeros((0, 0)))
    terms = np.vstack([doubt.terms, np.zeros((1, doubt.terms.shape[1]))])
    doubt = ModelDoubt(np.vstack([doubt.unknowns, row]), terms)
    return replace(first, row_s=first.row_s + change, uncertainty_s=sigma), replace(fit, doubt=doubt)


def row_time(fit: Adjustment) -> tuple[float, float, Array]:
    """Row time that remains in the points, its standard uncertainty, and the response of the unknowns per second."""
    views = fit.problem.views
    extra = [_derivative(fit.state, fit.problem, i, rate) for i, rate in enumerate(_velocities(fit.state.poses, views))]
    for i in (*range(ENDS), *range(len(views) - ENDS, len(views))):
        extra[i] = np.zeros_like(extra[i])
    terms = extra_terms(fit, [one[..., None] for one in extra])
    information = float(terms.matrix[0, 0])
    if not information > 0:
        return 0.0, float("inf"), np.zeros(len(terms.response))
    return float(terms.right[0]) / information, fit.scale / np.sqrt(information), terms.response[:, 0]


def _corrected(fit: Adjustment, views: Sequence[ChartView], row_s: float) -> list[ChartView]:
    """The views as all rows at the middle row's time would show them."""
    rates = _velocities(fit.state.poses, views)
    moved = [row_s * _derivative(fit.state, fit.problem, i, rate) for i, rate in enumerate(rates)]
    return [replace(view, points=view.points - one) for view, one in zip(views, moved, strict=True)]


def _derivative(state: AdjustmentState, problem: AdjustmentProblem, i: int, rate: Array) -> Array:
    """Displacement (n, 2) of a view's points per second of the row time."""
    view = problem.views[i]
    points = state.poses[i].apply(problem.shaped(state, view))
    velocity = by_pose(state.camera.by_points(points), points) @ rate
    return np.asarray((view.points[:, 1:] - (state.camera.rows - 1) / 2) * velocity)


def _velocities(poses: Sequence[Pose], views: Sequence[ChartView]) -> list[Array]:
    """Velocity (6,) of every view, as a change of its pose per second."""
    times = np.array([view.time_s for view in views])
    turns = RotationSpline(times, Rotation.from_matrix(np.array([pose.R for pose in poses])))
    shifts = CubicSpline(times, np.array([pose.t for pose in poses]))(times, 1)
    # the spline's rates are in the chart's axes
    spins = [pose.R @ rate for pose, rate in zip(poses, turns(times, 1), strict=True)]
    return [
        np.concatenate([spin, shift - np.cross(spin, pose.t)])
        for spin, shift, pose in zip(spins, shifts, poses, strict=True)
    ]
