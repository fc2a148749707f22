"""Which camera model: the one that foretells views that it was not fitted to.

The views are dealt out into two halves. A model is fitted to one half, the chart's shape with it; of each view of the
other half only the pose is fitted, six numbers for hundreds of points, and what is left over is counted. A model that
is too poor cannot draw the other views; one that is too rich has followed its own views' noise.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from procedures.geometry.adjustment import (
    POSE,
    Adjustment,
    AdjustmentState,
    NotConverged,
    adjust,
    by_pose,
    moved_pose,
)
from procedures.geometry.bundle import adjust_flat, first_bundle
from procedures.geometry.cameras import Camera, enriched, parameter_names, simple_camera, split_model
from procedures.geometry.shape import ShapeModel
from procedures.geometry.spline_camera import SplineCamera, spline_models
from procedures.geometry.views import ChartView, Pose
from procedures.outcome import Refused

Array = npt.NDArray[np.float64]

LEAST_VIEWS = 6
"""Of which half can be left out."""
AS_GOOD = 0.005
"""A simpler model is taken where it leaves no more than this above the best: 0.07 standard deviations of a point; or
no more than one standard error of the difference, over the views."""
FIRST, POOREST = "OPENCV", "SIMPLE_RADIAL"
"""The model of `first_state`; of a long lens, whose narrow frame does not tell the first from a turn."""
BASES = ("OPENCV", "THIN_PRISM_FISHEYE")
"""Formulas that splines are laid over, for narrow and for wide lenses: rich enough to leave them pixels, no more."""
POSE_STEPS, POSE_STILL = 20, 1e-3


@dataclass(frozen=True)
class ModelTrial:
    """A model that was tried.

    Attributes
    ----------
    model : str
    parameters : int
    left_over : float
        Mean square of what it leaves in views that it was not fitted to, in units of the points' covariances; inf where
        it could not be fitted, nan where there were too few views.
    converged : bool
        Whether its adjustment reached the minimum; where not, nothing is known of the model.
    """

    model: str
    parameters: int
    left_over: float
    converged: bool = True


def first_state(nodes: Array, views: Sequence[ChartView], size: tuple[int, int], shape: ShapeModel) -> AdjustmentState:
    """Camera, poses and the chart's shape by a model of few numbers: where every other begins."""
    bundle = first_bundle(nodes, views, size)
    start = AdjustmentState(bundle.camera, bundle.poses, np.zeros(len(shape.prior_mm)), np.zeros_like(nodes))
    try:
        return fit_model(FIRST, start, nodes, views, shape).state
    except Refused:
        return fit_model(POOREST, start, nodes, views, shape).state


def fit_model(
    model: str, start: AdjustmentState, nodes: Array, views: Sequence[ChartView], shape: ShapeModel
) -> Adjustment:
    """A model fitted to views, the chart's shape with it.

    The adjustment begins with the state's own camera where the model draws all that this can, else with what pycolmap
    finds for a chart of the state's shape. A spline begins where its formula alone ends.
    """
    base, grid = split_model(model)
    if any(grid):
        formula = fit_model(base, start, nodes, views, shape).state
        return adjust(replace(formula, camera=SplineCamera.over(formula.camera, model)), nodes, views, shape)
    camera = start.camera.base if isinstance(start.camera, SplineCamera) else start.camera
    known = enriched(camera, model)
    if known is not None:
        return adjust(replace(start, camera=known), nodes, views, shape)
    plain = simple_camera(model, camera.focal_px, camera.centre, (camera.columns, camera.rows))
    bundle = adjust_flat(plain, start.poses, nodes + start.deviations_mm(shape), views)
    return adjust(replace(start, camera=bundle.camera, poses=bundle.poses), nodes, views, shape)


def choose_model(
    models: Sequence[str], start: AdjustmentState, nodes: Array, views: Sequence[ChartView], shape: ShapeModel
) -> tuple[ModelTrial, ...]:
    """What was tried, the chosen one first.

    Parameters
    ----------
    models : sequence of str
        The simplest first.
    start : AdjustmentState
        Of all views.
    """
    if len(views) < LEAST_VIEWS or len(models) == 1:
        unknown = [ModelTrial(model, len(parameter_names(model)), float("nan")) for model in models]
        first = next((one for one in unknown if one.model == FIRST), unknown[0])
        return (first, *(one for one in unknown if one is not first))
    compared = _Comparison(start, nodes, views, shape)
    left = {model: compared.left_over(model) for model in models}
    freedom = np.array([2 * len(view) - POSE for view in views], dtype=np.float64)
    trials = [
        ModelTrial(model, len(parameter_names(model)), float(one.sum() / freedom.sum()), model not in compared.failed)
        for model, one in left.items()
    ]
    best = min(trials, key=lambda trial: trial.left_over)
    chosen = next(one for one in trials if one is best or _as_good(left[one.model], left[best.model], freedom))
    return (chosen, *sorted((trial for trial in trials if trial is not chosen), key=lambda trial: trial.left_over))


def with_splines(
    trials: tuple[ModelTrial, ...], size: tuple[int, int], start: AdjustmentState, nodes: Array,
    views: Sequence[ChartView], shape: ShapeModel,
) -> tuple[ModelTrial, ...]:  # fmt: skip
    """The trials once more with splines, over the formula that lies nearest to the lens, the chosen of all first."""
    base = min(BASES, key=lambda model: _residual(model, start, nodes, views, shape))
    best = trials[0].model
    first, *others = choose_model((best, *spline_models(base, *size)), start, nodes, views, shape)
    return (first, *sorted([*others, *trials[1:]], key=lambda trial: trial.left_over))


def _residual(model: str, start: AdjustmentState, nodes: Array, views: Sequence[ChartView], shape: ShapeModel) -> float:
    """Of a model fitted to all views, in units of the points' covariances; inf where it cannot be."""
    try:
        return fit_model(model, start, nodes, views, shape).scale
    except Refused:
        return float("inf")


def _as_good(one: Array, best: Array, freedom: Array) -> bool:
    """Whether what a model leaves of every view is about what the best one leaves."""
    if not np.isfinite(one).all():
        return False
    excess = (one - best) / freedom.mean()
    error = float(np.std(excess, ddof=1) / np.sqrt(len(excess)))
    return float(excess.mean()) <= max(AS_GOOD * float(best.sum() / freedom.sum()), error)


class _Comparison:
    """Models fitted to halves of the views one after the other, the poorest first.

    Attributes
    ----------
    failed : set of str
        Models whose adjustment did not converge.
    """

    def __init__(self, start: AdjustmentState, nodes: Array, views: Sequence[ChartView], shape: ShapeModel) -> None:
        self.start, self.nodes, self.views, self.shape = start, nodes, views, shape
        self.failed: set[str] = set()
        self._halves = [range(half, len(views), 2) for half in (0, 1)]
        self._ends: dict[range, AdjustmentState] = {}

    def left_over(self, model: str) -> Array:
        """What a model leaves of every view when it was fitted to the other half, in units of the covariances."""
        left = np.full(len(self.views), np.inf)
        try:
            ends = [self._fitted(model, half) for half in self._halves]
        except NotConverged:
            self.failed.add(model)
            return left
        except Refused:
            return left
        self._ends = dict(zip(self._halves, ends, strict=True))
        for end, others in zip(ends, reversed(self._halves), strict=True):
            for i in others:
                shaped = self.nodes + end.deviations_mm(self.shape)
                r = fit_pose(end.camera, self.start.poses[i], shaped, self.views[i])[1]
                left[i] = np.sum(r**2) if np.isfinite(r).all() else np.inf
        return left

    def _fitted(self, model: str, half: range) -> AdjustmentState:
        """The state of half of the views, from the first of several starts from which the adjustment converges."""
        views = [self.views[i] for i in half]
        for start in self._starts(model, half):
            try:
                return fit_model(model, start, self.nodes, views, self.shape).state
            except NotConverged as error:
                failure = error
        raise failure

    def _starts(self, model: str, half: range) -> Iterator[AdjustmentState]:
        if half in self._ends:
            yield self._ends[half]
        yield _part(self.start, half)
        yield _part(fit_model(model, self.start, self.nodes, self.views, self.shape).state, half)


def _part(state: AdjustmentState, views: range) -> AdjustmentState:
    """The state of some of the views."""
    return replace(state, poses=tuple(state.poses[i] for i in views))


def fit_pose(camera: Camera, pose: Pose, nodes: Array, view: ChartView) -> tuple[Pose, Array]:
    """The pose of a chart of known shape from one near it, and what it leaves over in standard deviations, (n, 2)."""
    whitening = view.whitening
    for _ in range(POSE_STEPS):
        points = pose.apply(nodes[view.index])
        r = np.einsum("nab,nb->na", whitening, view.points - camera.project(points))
        J = (whitening @ by_pose(camera.by_points(points), points)).reshape(-1, POSE)
        if not (np.isfinite(r).all() and np.isfinite(J).all()):  # a camera that does not see the chart so
            return pose, np.full_like(r, np.inf)
        step = np.linalg.lstsq(J, r.ravel(), rcond=None)[0]
        if np.linalg.norm(J @ step) < POSE_STILL:
            break
        pose = moved_pose(pose, step)
    return pose, r
