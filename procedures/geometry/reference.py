"""The reference camera: a spline over the stereographic projection, with a smoothness chosen by cross-validation.

The points of every view are divided at random into two halves. Camera, poses and chart are fitted to one half, and the
residual is counted in the other. A spline that is too smooth cannot describe the lens; one that is too rough has fitted
the noise. Both halves contain every view: they cover the same part of the frame, and the errors of the print are known.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from procedures.geometry.adjustment import (
    Adjustment,
    AdjustmentProblem,
    AdjustmentState,
    NotConverged,
    adjust,
    adjusted,
)
from procedures.geometry.bundle import first_bundle
from procedures.geometry.cameras import STEREOGRAPHIC, enriched, split_model
from procedures.geometry.conversion import as_model
from procedures.geometry.spline_camera import SplineCamera, spline_models
from procedures.geometry.uncertainty import covered_region
from procedures.outcome import Refused

ROUGHNESS_PX = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0)
"""Candidates for the standard deviation of the third differences of control points: the first leaves 0.1 pixel of cubic
terms over the frame, the last anything."""
FINER = (0.2, 0.6, 1.8)
"""Candidates of a finer grid, relative to the best of the coarser one: the same function has third differences smaller
by the cube of the spacing."""
TRIAL_TOLERANCE = 0.03
"""Convergence of a trial: a sixth of a standard uncertainty changes predictions by 1e-5 of their residual."""
WORTHWHILE = 0.001
"""Relative decrease of the predicted residual that is worth a finer grid, which takes four times as long."""
FIRST, SIMPLEST = "OPENCV", "SIMPLE_RADIAL"
"""The model of `first_state`; that for a long lens, whose narrow frame does not separate the first from a rotation."""


@dataclass(frozen=True)
class SmoothnessTrial:
    """A smoothness that was compared.

    roughness_px : float, standard deviation of the third differences of control points
    residual : float, mean square residual of points to which it was not fitted, in units of their covariances; inf
        where the adjustment did not converge
    """

    model: str
    roughness_px: float
    residual: float


def first_state(problem: AdjustmentProblem, size: tuple[int, int]) -> AdjustmentState:
    """State of a simple model, from which the others start."""
    bundle = first_bundle(problem.nodes, problem.views, size)
    start = problem.flat_state(bundle.camera, bundle.poses)
    if bundle.camera.model == STEREOGRAPHIC:
        return adjust(start, problem).state
    try:
        return fit_formula(FIRST, start, problem).state
    except Refused:
        return fit_formula(SIMPLEST, start, problem).state


def fit_formula(model: str, start: AdjustmentState, problem: AdjustmentProblem) -> Adjustment:
    """A formula fitted to views, together with the shape of the chart, from the state's camera converted to it."""
    camera = enriched(start.camera, model)
    if camera is None:
        region = covered_region(np.concatenate([view.points for view in problem.views]))
        camera = as_model(start.camera, region, model)[0]
    return adjust(replace(start, camera=camera), problem)


def fit_model(
    model: str | None, start: AdjustmentState, problem: AdjustmentProblem
) -> tuple[Adjustment, tuple[SmoothnessTrial, ...]]:
    """A model fitted to views, and for a spline the compared degrees of smoothness, the chosen one first.

    model : str or None, none: the reference
    """
    if model is not None and not any(split_model(model)[1]):
        return fit_formula(model, start, problem), ()
    coarse, fine = (
        spline_models(STEREOGRAPHIC, start.camera.columns, start.camera.rows) if model is None else (model, "")
    )
    formula = fit_formula(split_model(coarse)[0], start, problem).state
    trials = _trials(coarse, ROUGHNESS_PX, formula, problem)
    best = min(trials, key=lambda trial: trial.residual)
    if fine and best.residual < (1 - WORTHWHILE) * trials[0].residual:  # the lens has structure
        trials += _trials(fine, tuple(share * best.roughness_px for share in FINER), formula, problem)
        finest = min(trials, key=lambda trial: trial.residual)
        best = finest if finest.residual < (1 - WORTHWHILE) * best.residual else best
    camera = SplineCamera.over(formula.camera, best.model, best.roughness_px)
    fit = adjust(replace(formula, camera=camera), problem)
    return fit, (best, *(trial for trial in trials if trial is not best))


def _trials(
    model: str, roughness_px: Sequence[float], formula: AdjustmentState, problem: AdjustmentProblem
) -> list[SmoothnessTrial]:
    """Splines over a formula fitted to halves of the points, smooth to rough, until the predictions become worse."""
    halves, trials = _halves(problem), list[SmoothnessTrial]()
    camera = SplineCamera.over(formula.camera, model)
    size = camera.columns, camera.rows
    states = [replace(formula, camera=camera) for _ in halves]
    for one in roughness_px:
        try:
            states = [
                adjusted(
                    replace(state, camera=SplineCamera(model, state.camera.params, *size, one)), half, TRIAL_TOLERANCE
                )
                for state, half in zip(states, halves, strict=True)
            ]
            squares = [
                np.concatenate(half.view_residuals(state)) ** 2
                for state, half in zip(states, reversed(halves), strict=True)
            ]
            residual = float(np.mean(np.concatenate(squares)))
        except NotConverged:
            residual = float("inf")
        trials.append(SmoothnessTrial(model, one, residual))
        if residual > min(trial.residual for trial in trials):
            break
    return trials


def _halves(problem: AdjustmentProblem) -> tuple[AdjustmentProblem, AdjustmentProblem]:
    """The problem with one and the other random half of the points of every view."""
    rng = np.random.default_rng(0)
    chosen = [rng.permutation(len(view)) % 2 == 0 for view in problem.views]
    first, second = (
        [view.part(one == half) for view, one in zip(problem.views, chosen, strict=True)] for half in (True, False)
    )
    return replace(problem, views=first), replace(problem, views=second)
