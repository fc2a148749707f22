"""Algorithm I: picture and depth together, from a first depth to the pair of least cost (6.1).

One round is a joint Gauss-Newton step; some put the depth steps in their place first, or begin parts again. Rounds are
a generator, so whoever runs them shows progress, stops, keeps the state and resumes from it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procedures.restoration.first_depth.segments import Labels, SegmentSettings, joined, mended, segments
from procedures.restoration.joint.data_term import DataTerm, restore_picture
from procedures.restoration.joint.depth_edges import EdgeSettings, layers_of, place_steps
from procedures.restoration.joint.gauss_newton import PriorWeights, joint_step
from procedures.restoration.joint.noise_and_contrast import (
    band_powers,
    fitted_by_depth,
    gradient_powers,
    moments,
    standing_weights,
)
from procedures.restoration.joint.priors import depth_variation, roughness, steps_allowed, total_variation
from procedures.restoration.joint.restart_regions import RegionAttempt, RestartSettings, left_over, repaired
from procedures.restoration.joint.schedule import (
    PlaceEdges,
    RestartRegions,
    Schedule,
    Scheme,
    Statistics,
    openings,
)
from procedures.restoration.masks.blur_operator import Array, Blur

CONTRAST = 0.013
"""Mean squared gradient of textured scenes, white = 1: what is believed until one is restored."""
DECILES = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Where w of five equal parts of the frame lies."""


@dataclass(frozen=True)
class JointSettings:
    """How picture and depth are improved together, beside scheme and weights.

    Attributes
    ----------
    strong, yielding, most_left : float
        Weight of the depth's prior beyond which it bridges steps; it then yields with the power `yielding` of what is
        left over there, of the frame's median, up to `most_left` of that.
    least_gradient : float
        Gradient below which total variation is taken as quadratic (6.10), white = 1: grain of fine texture.
    contrast : float
        Mean squared gradient of the scene, white = 1, until one is restored.
    segments, edges, restart
        Of the depth map's segments, of placing its steps, and of parts begun again.
    """

    strong: float = 0.2
    yielding: float = 5
    most_left: float = 2.0
    least_gradient: float = 0.005
    contrast: float = CONTRAST
    segments: SegmentSettings = field(default_factory=SegmentSettings)
    edges: EdgeSettings = field(default_factory=EdgeSettings)
    restart: RestartSettings = field(default_factory=RestartSettings)


@dataclass(frozen=True)
class JointRound:
    """What one round did: cost (6.1) with the final weights, root mean square residual, mean change of w, seconds."""

    n: int
    what: str
    cost: float
    residual: float
    change: float
    seconds: float
    weights: PriorWeights


@dataclass(frozen=True)
class DescentState:
    """Where the rounds stand: n done, picture (C, H', W'), depth (H', W'), noise and contrast, history."""

    n: int
    u: Array
    w: Array
    known: Statistics
    history: tuple[JointRound, ...] = ()
    labels: Labels | None = None


@dataclass(frozen=True)
class Problem:
    """Photographs with their blurs, twice (two depths at once are needed at steps), and how to solve.

    reach : pixels about a depth step within which the first depth is not believed; misfit : (H', W'), where it did not
    fit the photographs, if that is known.
    """

    data: DataTerm
    other: DataTerm
    scheme: Scheme
    schedule: Schedule
    sigma: float
    reach: int
    total_variation: bool = False
    depth_variation: bool = False
    misfit: NDArray[np.bool_] | None = None
    settings: JointSettings = field(default_factory=JointSettings)


def problem_of(
    z: Array, stacks: list[Any], trust: Array, dtype: type[np.floating[Any]], blur: Callable[..., Any] = Blur
) -> tuple[DataTerm, DataTerm]:
    """The data term, twice, in one precision. z : (P, C, H, W); trust : (P, 1, H, W)."""
    shape = (z.shape[2], z.shape[3])
    one, two = (DataTerm(z.astype(dtype), [blur(s, shape, dtype) for s in stacks], trust.astype(dtype)) for _ in (0, 1))
    return one, two


def begin(problem: Problem, w: Array) -> DescentState:
    """The state at a first depth w (H, W): extended beyond the frame, its picture restored softly."""
    data = problem.data
    R, dtype = data.R, data.z.dtype
    wide = np.pad(w, R, mode="edge").astype(dtype)
    mean = (data.z * data.trust).sum(axis=0) / np.maximum(data.trust.sum(axis=0), 1e-6)
    u = np.pad(mean, ((0, 0), (R, R), (R, R)), mode="edge").astype(dtype)
    data.focus(wide)
    known = Statistics(problem.sigma, problem.sigma, problem.settings.contrast)
    weight = max(1e-3, problem.schedule.final(known).picture)
    return DescentState(0, restore_picture(data, u, weight, 15), wide, known)


def cost(problem: Problem, u: Array, w: Array, weights: PriorWeights) -> tuple[float, float]:
    """Cost (6.1) and the robust root mean square residual of a pair; the data term is left focused on w."""
    problem.data.focus(w)
    e = problem.data.residual(u)
    prior = weights.picture * roughness(u, *_diffusion(problem, u))
    prior += weights.depth_cost(w, *_edges(problem, e, w, weights, None))
    return 0.5 * float(np.sum(e**2)) + prior, float(np.median(np.abs(e)) / 0.6745)


def _diffusion(problem: Problem, u: Array) -> tuple[Array | float, Array | float]:
    """The picture prior's weights: 1 for Tikhonov, 1 / |grad u| scaled to the same mean for total variation."""
    if not problem.total_variation:
        return 1.0, 1.0
    down, across = total_variation(u, problem.settings.least_gradient)
    scale = np.sqrt(problem.settings.contrast) / 3
    return down * u.dtype.type(scale), across * u.dtype.type(scale)


def _edges(
    problem: Problem, e: Array | None, w: Array, weights: PriorWeights, labels: Labels | None
) -> tuple[Array, Array]:
    """The depth prior's weights: none between segments; within them less where w is steep.

    A prior so strong that it bridges steps counts less where e, if given, is left over of the photographs, too.
    """
    s, slope = problem.settings, problem.schedule.weights.slope
    down, across = depth_variation(w, slope) if problem.depth_variation else steps_allowed(w, weights.step)
    if e is not None and weights.depth > s.strong:
        left = np.clip(left_over(e, s.restart.window), 1, s.most_left) ** -s.yielding
        held = np.pad(left, problem.data.R, mode="edge").astype(w.dtype)
        down, across = down * np.minimum(held[1:], held[:-1]), across * np.minimum(held[:, 1:], held[:, :-1])
    if labels is None:
        return down, across
    same_down, same_across = joined(labels)
    return down * same_down, across * same_across


def rounds(problem: Problem, state: DescentState) -> Iterator[DescentState]:
    """States after each further round, up to the scheme's number."""
    while state.n < problem.scheme.rounds:
        yield (state := one_round(problem, state))


def one_round(problem: Problem, state: DescentState) -> DescentState:
    """The state after one more round: what opens it, then a joint step."""
    start = time.perf_counter()
    weights = problem.schedule.at(state.n, state.known)
    opening = openings(problem.scheme.rounds)[state.n]
    u, w, labels = state.u, state.w, state.labels
    if isinstance(opening, RestartRegions):
        u, w, labels = _repaired(problem, state, weights)
    else:
        if opening is not None:
            u, w, labels = _placed(problem, state, opening, weights)
        u, w = _joint(problem, u, w, labels, weights, settled=state.n > 0)
    final = problem.schedule.final(state.known)
    value, residual = cost(problem, u, w, final)
    done = JointRound(
        state.n, f"{opening.said} + joint" if opening else "joint", value, residual,
        float(np.abs(w - state.w).mean()), time.perf_counter() - start, weights,
    )  # fmt: skip
    return DescentState(state.n + 1, u, w, _statistics(problem, u, w, weights), (*state.history, done), labels)


def _joint(
    problem: Problem, u: Array, w: Array, labels: Labels | None, weights: PriorWeights, settled: bool = True
) -> tuple[Array, Array]:
    """Picture and depth after one joint Gauss-Newton step.

    settled : what u leaves over is of the depth, not of a picture that has only been restored softly.
    """
    iterations = problem.scheme.picture + problem.scheme.depth
    problem.data.focus(w)
    edges = _edges(problem, problem.data.residual(u) if settled else None, w, weights, labels)
    return joint_step(problem.data, u, w, weights, iterations, _diffusion(problem, u), edges)


def _repaired(problem: Problem, state: DescentState, weights: PriorWeights) -> tuple[Array, Array, Labels]:
    """Picture, depth and segments some joint steps on, the parts that are not explained begun again."""
    s, jump = problem.settings, problem.settings.segments.jump

    def onward(pair: RegionAttempt) -> RegionAttempt:
        for _ in range(s.restart.on_trial):
            u, w = _joint(problem, pair.u, pair.w, pair.labels, weights)
            pair = RegionAttempt(u, w, pair.labels)
        return pair

    old = RegionAttempt(state.u, state.w, segments(state.w, s.segments, s.restart.doubt, state.labels))
    found = repaired(problem.data, problem.other, old, problem.reach, jump, weights.picture, onward, s.restart, s.edges)
    return found.u, found.w, found.labels


def _placed(
    problem: Problem, state: DescentState, step: PlaceEdges, weights: PriorWeights
) -> tuple[Array, Array, Labels]:
    """Picture, depth and segments with the depth steps put in their place, from afar or from near."""
    reach, doubt = (step.reach, step.doubt) if step.reach is not None else (problem.reach, problem.reach - 1)
    s = problem.settings
    labels = segments(state.w, s.segments, doubt, state.labels)
    w = mended(state.w, labels, doubt, s.segments) if step.far else state.w
    # from afar a step is looked for only where the first depth did not fit
    where = problem.misfit if step.far else None
    layers = layers_of(w, labels, reach, doubt, s.segments.jump, step.layers, where)
    soft = max(weights.picture, step.softness)
    return place_steps(problem.data, problem.other, state.u, w, labels, layers, soft, step.decided, s.edges)


def _statistics(problem: Problem, u: Array, w: Array, weights: PriorWeights) -> Statistics:
    """What residual and picture of a round suggest. The data term is focused on w.

    The noise is at most half above the first, which no picture at any depth explains: masks that err are in it, a depth
    not found yet is not.
    """
    R, stacks = problem.data.R, [blur.stack for blur in problem.data.blurs]
    e = problem.data.residual(u)
    inside, downhill = (one[:, R:-R, R:-R].astype(np.float64) for one in (u, problem.data.blur_adjoint(e)))
    depths, fitted = np.quantile(w[R:-R, R:-R], DECILES), fitted_by_depth(problem.data, u, weights)
    powers = band_powers(e.astype(np.float64)), gradient_powers(inside)
    told = moments(stacks, depths, standing_weights(inside, downhill), *powers, fitted)
    sigma, deciding = (min(float(np.sqrt(one)), 1.5 * problem.sigma) for one in (told.noise, told.deciding))
    return Statistics(sigma, deciding, told.contrast)


def picture_alone(
    problem: Problem, state: DescentState, progress: Callable[[JointRound], None] | None = None, rounds: int = 4
) -> DescentState:
    """The state of a scene whose w is known: the picture, its noise and contrast in turn, then the final picture."""
    for _ in range(rounds):
        weights = problem.schedule.final(state.known)
        iterations = problem.scheme.picture + problem.scheme.depth
        u = restore_picture(problem.data, state.u, weights.picture, iterations, _diffusion(problem, state.u))
        state = replace(state, u=u, known=_statistics(problem, u, state.w, weights))
    done = finish(problem, state)
    if progress:
        progress(done.history[-1])
    return done


def finish(problem: Problem, state: DescentState) -> DescentState:
    """The picture alone, at the depth found, with the final weight: N_TV times N_u iterations."""
    start = time.perf_counter()
    weights = problem.schedule.final(state.known)
    problem.data.focus(state.w)
    u = state.u
    for _ in range(problem.scheme.final_rounds):
        u = restore_picture(problem.data, u, weights.picture, problem.scheme.final, _diffusion(problem, u))
    value, residual = cost(problem, u, state.w, weights)
    done = JointRound(state.n, "picture", value, residual, 0.0, time.perf_counter() - start, weights)
    return replace(state, u=u, history=(*state.history, done))


def run(problem: Problem, state: DescentState, progress: Callable[[JointRound], None] | None = None) -> DescentState:
    """All remaining rounds and the final picture, from the best pair met on the way."""
    best = last = state
    for last in rounds(problem, state):
        if progress:
            progress(last.history[-1])
        # costs compare under one pair of weights only
        weights = problem.schedule.final(last.known)
        if cost(problem, last.u, last.w, weights)[0] <= 1.05 * cost(problem, best.u, best.w, weights)[0]:
            best = last
    done = finish(problem, replace(best, n=last.n, history=last.history))
    if progress:
        progress(done.history[-1])
    return done
