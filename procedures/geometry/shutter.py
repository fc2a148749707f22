"""Row time of a rolling shutter, from frames of a video in which the chart or the camera moves.

A row y is exposed y times the row time r after the first, so that a point at row y appears where the moving chart is
at that time. The poses refer to the time of the middle row y0; a cubic spline through them gives the chart's pose at
the time r (y - y0) of every point. The adjustment is that of all views with their neighbours, since a pose that is
wrong displaces the points of the views around it. With r as a further unknown, by which a point moves by y - y0 times
its velocity in the frame, it is repeated until r does not change.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from procedures.geometry.adjustment import (
    POSE,
    Adjustment,
    AdjustmentProblem,
    AdjustmentState,
    ModelDiscrepancy,
    adjust,
    extra_terms,
)
from procedures.geometry.views import ChartView
from procedures.numerics.arrays import Array, Indices
from procedures.outcome import Refused

FEWEST_FRAMES = 6  # frames of a video that show how the chart moves
ITERATIONS, NEGLIGIBLE = 6, 0.05
"""Corrections of the points at most; change of the row time, in standard uncertainties, that needs no further one."""
SIGNIFICANT = 3.0  # row time, in standard uncertainties, from which the shutter is a rolling one
SHARP_S = 1e-3  # uncertainty of the readout time up to which a shutter without a significant row time is a global one
STEP_S = 1e-7  # change of the row time by which points are displaced for their derivative
ROUNDS = 3
"""Projections that give the rows of moving points: each reduces their error by the path during a row, in rows."""
NEAR = 4  # views before and after one, whose poses displace its points


@dataclass(frozen=True)
class ShutterTiming:
    """Row time of a camera.

    row_s, uncertainty_s : float, time between the exposures of neighbouring rows; positive where lower rows are later
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


@dataclass(frozen=True, eq=False)
class MovingProblem(AdjustmentProblem):
    """Views of a moving chart by a camera whose rows are exposed one after the other.

    row_s : float, time between neighbouring rows
    """

    row_s: float = 0.0

    def placed(self, state: AdjustmentState, i: int) -> Array:
        """Positions (n, 3) of a view's nodes in its camera's frame, each at the time of its row."""
        return self.placed_at(state, i, _times(state, self)[i])

    def still(self, state: AdjustmentState, i: int) -> ChartView:
        """A view with all points at the middle row's time."""
        moved = state.camera.project(self.placed(state, i)) - state.camera.project(super().placed(state, i))
        return replace(self.views[i], points=self.views[i].points - moved)

    def jacobian(self, state: AdjustmentState, i: int) -> tuple[Array, Array]:
        """Derivatives as of the base, with six columns for each of the poses `near` the view."""
        J, by_nodes = super().jacobian(state, i)
        weights = _weights(self)(_times(state, self)[i])[:, self._near(i)]
        of_poses = J[..., None, -POSE:] * weights[:, None, :, None]
        return np.concatenate([J[..., :-POSE], of_poses.reshape(*J.shape[:2], -1)], -1), by_nodes

    def places(self, state: AdjustmentState, i: int) -> Indices:
        """Indices of camera, shape terms and the poses near a view among the unknowns."""
        near, first = self._near(i), len(state.camera.params) + len(state.terms_mm)
        places: Indices = np.r_[:first, first + POSE * near.start : first + POSE * near.stop]
        return places

    def _near(self, i: int) -> slice:
        """The poses that a view's points depend on: the weights of others in a spline are below 0.01."""
        return slice(max(0, i - NEAR), min(len(self.views), i + NEAR + 1))

    def placed_at(self, state: AdjustmentState, i: int, times: Array) -> Array:
        """Positions (n, 3) of a view's nodes in its camera's frame at times (n,)."""
        turns, shifts = _motion(state, self)
        nodes = self.shaped(state, self.views[i])
        return np.asarray(Rotation.from_quat(turns(times)).apply(nodes) + shifts(times))


@lru_cache(maxsize=2)
def _times(state: AdjustmentState, problem: MovingProblem) -> list[Array]:
    """Times (n,) of the rows of every view's points.

    Rows are those of the projected points: noise of observed rows would be that of the residuals, and displace the row
    time by its product with the mean velocity.
    """
    times = [np.full(len(view), view.time_s) for view in problem.views]
    for _ in range(ROUNDS):
        for i, view in enumerate(problem.views):
            rows = state.camera.project(problem.placed_at(state, i, times[i]))[:, 1]
            times[i] = view.time_s + problem.row_s * (rows - (state.camera.rows - 1) / 2)
    return times


@lru_cache(maxsize=2)
def _weights(problem: MovingProblem) -> CubicSpline:
    times = [view.time_s for view in problem.views]
    return CubicSpline(times, np.eye(len(times)))


@lru_cache(maxsize=2)
def _motion(state: AdjustmentState, problem: MovingProblem) -> tuple[CubicSpline, CubicSpline]:
    """Splines through the poses over time: unit quaternions, each next to the one before, and shifts."""
    times = np.array([view.time_s for view in problem.views])
    turns = Rotation.from_matrix(np.array([pose.R for pose in state.poses])).as_quat()
    signs = np.where(np.sum(turns[1:] * turns[:-1], axis=1) < 0, -1.0, 1.0)
    turns[1:] *= np.cumprod(signs)[:, None]
    return CubicSpline(times, turns), CubicSpline(times, np.array([pose.t for pose in state.poses]))


def find_shutter(state: AdjustmentState, problem: AdjustmentProblem) -> tuple[ShutterTiming, MovingProblem]:
    """The row time by a simple camera, and the problem with it.

    Raises Refused if the views are too few to show how the chart moves.
    """
    if len(problem.views) < FEWEST_FRAMES:
        raise Refused(
            f"the row time of a shutter needs {FEWEST_FRAMES} frames that show the chart; there are "
            f"{len(problem.views)}",
            "record a longer video, or omit --frame-rate-hz",
        )
    moving = MovingProblem(problem.nodes, problem.views, problem.shape)
    for _ in range(ITERATIONS):
        fit = adjust(state, moving)
        change, sigma, _ = row_time(fit)
        moving, state = replace(moving, row_s=moving.row_s + change), fit.state
        if abs(change) < NEGLIGIBLE * sigma:
            break
    return ShutterTiming(moving.row_s, sigma, state.camera.rows), moving


def with_row_time(fit: Adjustment, first: ShutterTiming) -> tuple[ShutterTiming, Adjustment]:
    """The row time by the final camera, and the adjustment with its uncertainty among the discrepancies."""
    change, sigma, response = row_time(fit)
    row = (sigma * response)[None]
    discrepancy = fit.discrepancy or ModelDiscrepancy(np.zeros((0, len(response))), np.zeros((0, 0)))
    terms = np.vstack([discrepancy.terms, np.zeros((1, discrepancy.terms.shape[1]))])
    discrepancy = ModelDiscrepancy(np.vstack([discrepancy.unknowns, row]), terms)
    return replace(first, row_s=first.row_s + change, uncertainty_s=sigma), replace(fit, discrepancy=discrepancy)


def row_time(fit: Adjustment) -> tuple[float, float, Array]:
    """Change of the row time, its standard uncertainty, and the response of the unknowns per second."""
    problem, state = fit.problem, fit.state
    assert isinstance(problem, MovingProblem)
    ahead, behind = (
        [state.camera.project(moved.placed(state, i)) for i in range(len(problem.views))]
        for moved in (replace(problem, row_s=problem.row_s + step) for step in (STEP_S, -STEP_S))
    )
    terms = extra_terms(fit, [(a - b)[..., None] / (2 * STEP_S) for a, b in zip(ahead, behind, strict=True)])
    information = float(terms.matrix[0, 0])
    if not information > 0:
        return 0.0, float("inf"), np.zeros(len(terms.response))
    return float(terms.right[0]) / information, fit.scale / np.sqrt(information), terms.response[:, 0]
