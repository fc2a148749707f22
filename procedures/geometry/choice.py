"""Choice of the camera model by cross-validation.

The views are divided into two halves. A model is fitted to one half, together with the shape of the chart; for each
view of the other half only the pose is fitted, six parameters for several hundred points, and the residual is counted.
A model that is too simple cannot describe the other views; one that is too flexible has fitted the noise of its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from procedures.geometry.adjustment import (
    POSE,
    Adjustment,
    AdjustmentProblem,
    AdjustmentState,
    NotConverged,
    adjust,
    by_pose,
    moved_pose,
)
from procedures.geometry.bundle import first_bundle
from procedures.geometry.cameras import STEREOGRAPHIC, CameraModel, enriched, parameter_names, split_model
from procedures.geometry.conversion import as_model
from procedures.geometry.spline_camera import SplineCamera, spline_models
from procedures.geometry.uncertainty import covered_region
from procedures.geometry.views import ChartView, Pose
from procedures.outcome import Refused

Array = npt.NDArray[np.float64]

LEAST_VIEWS = 6
"""Number of views required for cross-validation."""
EQUIVALENCE = 0.005
"""A simpler model is preferred where its residual exceeds that of the best by no more than this fraction (0.07 standard
deviations of a point), or by no more than one standard error of the difference over the views."""
FIRST, SIMPLEST = "OPENCV", "SIMPLE_RADIAL"
"""The model of `first_state`; that for a long lens, whose narrow frame does not separate the first from a rotation."""
MAX_POSE_ITERATIONS, POSE_TOLERANCE = 20, 1e-3


@dataclass(frozen=True)
class ModelTrial:
    """A model that was compared.

    Attributes
    ----------
    parameters : int
        Number of parameters.
    left_over : float
        Mean square residual in views to which it was not fitted, in units of the covariances of the points; inf where
        it could not be fitted, nan where there were too few views.
    converged : bool
        Whether its adjustment converged; if not, nothing is known about the model.
    """

    model: str
    parameters: int
    left_over: float
    converged: bool = True


def first_state(problem: AdjustmentProblem, size: tuple[int, int]) -> AdjustmentState:
    """State of a simple model, from which the others start."""
    bundle = first_bundle(problem.nodes, problem.views, size)
    start = problem.flat_state(bundle.camera, bundle.poses)
    if bundle.camera.model == STEREOGRAPHIC:
        return adjust(start, problem).state
    try:
        return fit_model(FIRST, start, problem).state
    except Refused:
        return fit_model(SIMPLEST, start, problem).state


def fit_model(model: str, start: AdjustmentState, problem: AdjustmentProblem) -> Adjustment:
    """A model fitted to views, together with the shape of the chart.

    The adjustment starts from the state's camera, converted to the model; that of a spline from the result of
    its formula.
    """
    base, grid = split_model(model)
    if any(grid):
        formula = fit_model(base, start, problem).state
        return adjust(replace(formula, camera=SplineCamera.over(formula.camera, model)), problem)
    camera = start.camera.base if isinstance(start.camera, SplineCamera) else start.camera
    known = enriched(camera, model)
    if known is None:
        region = covered_region(np.concatenate([view.points for view in problem.views]))
        known = as_model(camera, region, model)[0]
    return adjust(replace(start, camera=known), problem)


def choose_model(models: Sequence[str], start: AdjustmentState, problem: AdjustmentProblem) -> tuple[ModelTrial, ...]:
    """The compared models, the chosen one first.

    Parameters
    ----------
    models : sequence of str
        The simplest first.
    start : AdjustmentState
        Of all views.
    """
    views = problem.views
    if len(views) < LEAST_VIEWS or len(models) == 1:
        unknown = [ModelTrial(model, len(parameter_names(model)), float("nan")) for model in models]
        first = next((one for one in unknown if one.model == FIRST), unknown[0])
        return (first, *(one for one in unknown if one is not first))
    comparison = _CrossValidation(start, problem)
    residuals = {model: comparison.residuals(model) for model in models}
    freedom = np.array([2 * len(view) - POSE for view in views], dtype=np.float64)
    trials = [
        ModelTrial(model, len(parameter_names(model)), float(one.sum() / freedom.sum()), model not in comparison.failed)
        for model, one in residuals.items()
    ]
    best = min(trials, key=lambda trial: trial.left_over)
    chosen = next(
        one for one in trials if one is best or _equivalent(residuals[one.model], residuals[best.model], freedom)
    )
    return (chosen, *sorted((trial for trial in trials if trial is not chosen), key=lambda trial: trial.left_over))


def with_splines(
    trials: tuple[ModelTrial, ...], size: tuple[int, int], start: AdjustmentState, problem: AdjustmentProblem
) -> tuple[ModelTrial, ...]:
    """The trials with splines over the stereographic formula, the chosen model first."""
    first, *others = choose_model((trials[0].model, *spline_models(STEREOGRAPHIC, *size)), start, problem)
    return (first, *sorted([*others, *trials[1:]], key=lambda trial: trial.left_over))


def _equivalent(one: Array, best: Array, freedom: Array) -> bool:
    """Whether the residuals of a model in every view are about those of the best one."""
    if not np.isfinite(one).all():
        return False
    excess = (one - best) / freedom.mean()
    error = float(np.std(excess, ddof=1) / np.sqrt(len(excess)))
    return float(excess.mean()) <= max(EQUIVALENCE * float(best.sum() / freedom.sum()), error)


class _CrossValidation:
    """Models fitted to halves of the views in turn, the simplest first; `failed` did not converge."""

    def __init__(self, start: AdjustmentState, problem: AdjustmentProblem) -> None:
        self.start, self.problem = start, problem
        self.failed: set[str] = set()
        self._halves = [range(half, len(problem.views), 2) for half in (0, 1)]
        self._ends: dict[range, AdjustmentState] = {}

    def residuals(self, model: str) -> Array:
        """Sum of squares in every view of a model fitted to the other half, in units of the covariances."""
        problem, squares = self.problem, np.full(len(self.problem.views), np.inf)
        try:
            ends = [self._fitted(model, half) for half in self._halves]
        except NotConverged:
            self.failed.add(model)
            return squares
        except Refused:
            return squares
        self._ends = dict(zip(self._halves, ends, strict=True))
        for end, others in zip(ends, reversed(self._halves), strict=True):
            for i in others:
                shaped = problem.nodes + end.deviations_mm(problem.shape)
                r = fit_pose(end.camera, self.start.poses[i], shaped, problem.views[i])[1]
                squares[i] = np.sum(r**2) if np.isfinite(r).all() else np.inf
        return squares

    def _fitted(self, model: str, half: range) -> AdjustmentState:
        """State for half of the views, from the first of several starts that converges."""
        problem = replace(self.problem, views=[self.problem.views[i] for i in half])
        for start in self._starts(model, half):
            try:
                return fit_model(model, start, problem).state
            except NotConverged as error:
                failure = error
        raise failure

    def _starts(self, model: str, half: range) -> Iterator[AdjustmentState]:
        if half in self._ends:
            yield self._ends[half]
        yield _subset(self.start, half)
        yield _subset(fit_model(model, self.start, self.problem).state, half)


def _subset(state: AdjustmentState, views: range) -> AdjustmentState:
    return replace(state, poses=tuple(state.poses[i] for i in views))


def fit_pose(camera: CameraModel, pose: Pose, nodes: Array, view: ChartView) -> tuple[Pose, Array]:
    """Pose of a chart of known shape from a nearby one, and the residuals in standard deviations, (n, 2)."""
    whitening = view.whitening
    for _ in range(MAX_POSE_ITERATIONS):
        points = pose.apply(nodes[view.index])
        r = np.einsum("nab,nb->na", whitening, view.points - camera.project(points))
        J = (whitening @ by_pose(camera.by_points(points), points)).reshape(-1, POSE)
        if not (np.isfinite(r).all() and np.isfinite(J).all()):  # the chart is outside the field of view
            return pose, np.full_like(r, np.inf)
        step = np.linalg.lstsq(J, r.ravel(), rcond=None)[0]
        if np.linalg.norm(J @ step) < POSE_TOLERANCE:
            break
        pose = moved_pose(pose, step)
    return pose, r
