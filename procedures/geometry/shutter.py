"""Row time of a rolling shutter, from frames of a video in which the chart or the camera moves.

A row y is exposed y times the row time r after the first, so that a point at row y appears where the moving chart is
at that time. The poses refer to the time of the middle row y0. A cubic spline through them gives the chart's pose at
the time r (y - y0) of every point, and thus its displacement, for which the points are corrected. The correction is
repeated with r as a further unknown of the adjustment: a point moves by y - y0 times its velocity in the frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from procedures.geometry.adjustment import (
    Adjustment,
    AdjustmentProblem,
    AdjustmentState,
    ModelDoubt,
    adjust,
    extra_terms,
)
from procedures.geometry.views import ChartView
from procedures.outcome import Refused

Array = npt.NDArray[np.float64]

FEWEST_FRAMES = 6
"""Frames of a video that show how the chart moves."""
ITERATIONS, NEGLIGIBLE = 12, 0.05
"""Corrections of the points at most; change of the row time, in standard uncertainties, that needs no further one."""
SIGNIFICANT = 3.0
"""Row time, in standard uncertainties, from which the shutter is a rolling one."""
SHARP_S = 1e-3
"""Uncertainty of the readout time up to which a shutter without a significant row time is a global one."""
STEP_S = 1e-4
"""Half of the time over which velocities are taken."""
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
    extra = [_from_middle(view, fit)[:, None] * velocity for view, velocity in zip(views, _velocities(fit), strict=True)]
    for i in (*range(ENDS), *range(len(views) - ENDS, len(views))):
        extra[i] = np.zeros_like(extra[i])
    terms = extra_terms(fit, [one[..., None] for one in extra])
    information = float(terms.matrix[0, 0])
    if not information > 0:
        return 0.0, float("inf"), np.zeros(len(terms.response))
    return float(terms.right[0]) / information, fit.scale / np.sqrt(information), terms.response[:, 0]


def _corrected(fit: Adjustment, views: Sequence[ChartView], row_s: float) -> list[ChartView]:
    """The views as all rows at the middle row's time would show them."""
    motion = _Motion.of(fit)
    moved = [
        motion.points(fit, view, row_s * _from_middle(view, fit)) - motion.points(fit, view, np.zeros(len(view)))
        for view in views
    ]
    return [replace(view, points=view.points - one) for view, one in zip(views, moved, strict=True)]


def _velocities(fit: Adjustment) -> list[Array]:
    """Velocities (n, 2) of the points of every view, in pixels per second."""
    motion, views = _Motion.of(fit), fit.problem.views
    steps = [np.full(len(view), STEP_S) for view in views]
    return [
        (motion.points(fit, view, step) - motion.points(fit, view, -step)) / (2 * STEP_S)
        for view, step in zip(views, steps, strict=True)
    ]


def _from_middle(view: ChartView, fit: Adjustment) -> Array:
    """Rows (n,) of a view's points, from the middle one."""
    return np.asarray(view.points[:, 1] - (fit.state.camera.rows - 1) / 2)


@dataclass(frozen=True, eq=False)
class _Motion:
    """Splines through the poses over time: unit quaternions, each next to the one before, and shifts."""

    turns: CubicSpline
    shifts: CubicSpline

    @classmethod
    def of(cls, fit: Adjustment) -> _Motion:
        times, poses = np.array([view.time_s for view in fit.problem.views]), fit.state.poses
        turns = Rotation.from_matrix(np.array([pose.R for pose in poses])).as_quat()
        signs = np.where(np.sum(turns[1:] * turns[:-1], axis=1) < 0, -1.0, 1.0)
        turns[1:] *= np.cumprod(signs)[:, None]
        return cls(CubicSpline(times, turns), CubicSpline(times, np.array([pose.t for pose in poses])))

    def points(self, fit: Adjustment, view: ChartView, after_s: Array) -> Array:
        """Pixels (n, 2) of a view's nodes, each at its own time (n,) after the view's."""
        times = view.time_s + after_s
        turns = Rotation.from_quat(self.turns(times))
        return fit.state.camera.project(turns.apply(fit.problem.shaped(fit.state, view)) + self.shifts(times))
