"""Algorithm I: picture and depth together, from a first depth to the pair of minimal cost (6.1).

One round is a joint Gauss-Newton step; some rounds first localise depth edges, or restart regions. Rounds are a
generator, so that the caller can show progress, stop, store the state and resume from it.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, distance_transform_edt, label, maximum_filter, uniform_filter

from procedures.numerics.arrays import Mask
from procedures.restoration.first_depth.segments import Labels, joined, remove_blemishes, segments, surfaces
from procedures.restoration.joint.data_term import DataTerm, restore_picture
from procedures.restoration.joint.depth_edges import FULL, Effort, layers_of, place_steps
from procedures.restoration.joint.gauss_newton import PriorWeights, joint_step
from procedures.restoration.joint.noise_and_contrast import (
    DECILES,
    band_powers,
    depth_freedom,
    effective_weights,
    gradient_powers,
    moments,
)
from procedures.restoration.joint.priors import bending, depth_variation, roughness, steps_allowed, total_variation
from procedures.restoration.joint.schedule import (
    CONSTANT,
    DEPTH_SLOPE,
    PlaceEdges,
    RestartRegions,
    Schedule,
    Scheme,
    Statistics,
    openings,
)
from procedures.restoration.masks.blur_operator import Array, BlurOperator

CONTRAST = 0.013
"""Mean squared gradient of textured scenes, white = 1: assumed until a picture is restored."""


STRONG, YIELDING, MOST_LEFT = 0.2, 5.0, 2.0
"""Weight of the depth's prior above which it smooths over edges; it is then reduced by the power `YIELDING` of the
local residual relative to the frame's median, up to `MOST_LEFT` of that."""
LEAST_GRADIENT = 0.005
"""Gradient below which total variation is taken as quadratic (6.10), white = 1: grain of fine texture."""
ON_TRIAL = 3
"""Joint steps before a restarted region is compared with its previous state."""


@dataclass(frozen=True)
class JointRound:
    """Log of one round: cost (6.1) with the final weights, root mean square residual, mean change of w, seconds."""

    n: int
    what: str
    cost: float
    residual: float
    change: float
    seconds: float
    weights: PriorWeights


@dataclass(frozen=True)
class DescentState:
    """State between rounds: number done, picture (C, H', W'), depth (H', W'), noise and contrast, history."""

    n: int
    u: Array
    w: Array
    statistics: Statistics
    history: tuple[JointRound, ...] = ()
    labels: Labels | None = None


@dataclass(frozen=True)
class JointProblem:
    """Photographs with their blurs, twice (two depths at once are needed at edges), and parameters.

    reach : pixels about a depth edge within which the first depth is unreliable; misfit : (H', W'), where it did not
    fit the photographs, if known; edges : effort of their localisation; yielding : see `YIELDING`.
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
    edges: Effort = FULL
    yielding: float = YIELDING


def problem_of(
    z: Array, stacks: list[Any], trust: Array, dtype: type[np.floating[Any]], blur: Callable[..., Any] = BlurOperator
) -> tuple[DataTerm, DataTerm]:
    """Two copies of the data term in one precision. z : (P, C, H, W); trust : (P, 1, H, W)."""
    shape = (z.shape[2], z.shape[3])
    one, two = (DataTerm(z.astype(dtype), [blur(s, shape, dtype) for s in stacks], trust.astype(dtype)) for _ in (0, 1))
    return one, two


def begin(problem: JointProblem, w: Array) -> DescentState:
    """The initial state at a first depth w (H, W): extended beyond the frame, with a smooth picture."""
    data = problem.data
    R, dtype = data.R, data.z.dtype
    wide = np.pad(w, R, mode="edge").astype(dtype)
    u = data.mean().astype(dtype)
    data.focus(wide)
    statistics = Statistics(problem.sigma, problem.sigma, CONTRAST)
    weight = max(1e-3, problem.schedule.final(statistics).picture)
    return DescentState(0, restore_picture(data, u, weight, 15), wide, statistics)


def cost(problem: JointProblem, u: Array, w: Array, weights: PriorWeights) -> tuple[float, float]:
    """Cost (6.1) and robust root mean square residual of a pair; leaves the data term focused on w."""
    problem.data.focus(w)
    e = problem.data.residual(u)
    prior = weights.picture * roughness(u, *_diffusion(problem, u))
    edges = _edges(problem, e, w, weights, None)
    prior += weights.depth * (weights.tilt * roughness(w, *edges) + weights.bend * bending(w, *edges))
    return 0.5 * float(np.sum(e**2)) + prior, float(np.median(np.abs(e)) / 0.6745)


def _diffusion(problem: JointProblem, u: Array) -> tuple[Array | float, Array | float]:
    """Weights of the picture prior: 1 for Tikhonov, 1 / |grad u| scaled to the same mean for total variation."""
    if not problem.total_variation:
        return 1.0, 1.0
    down, across = total_variation(u, LEAST_GRADIENT)
    scale = np.sqrt(CONTRAST) / 3
    return down * u.dtype.type(scale), across * u.dtype.type(scale)


def _edges(
    problem: JointProblem, e: Array | None, w: Array, weights: PriorWeights, labels: Labels | None
) -> tuple[Array, Array]:
    """Weights of the depth prior: 0 between segments, and smaller where w is steep.

    A prior so strong that it smooths over edges is also reduced where the residual e, if given, is large.
    """
    down, across = depth_variation(w, DEPTH_SLOPE) if problem.depth_variation else steps_allowed(w, weights.step)
    if e is not None and weights.depth > STRONG:
        yielding = np.clip(relative_residual(e), 1, MOST_LEFT) ** -problem.yielding
        wide = np.pad(yielding, problem.data.R, mode="edge").astype(w.dtype)
        down, across = down * np.minimum(wide[1:], wide[:-1]), across * np.minimum(wide[:, 1:], wide[:, :-1])
    if labels is None:
        return down, across
    same_down, same_across = joined(labels)
    return down * same_down, across * same_across


def rounds(problem: JointProblem, state: DescentState) -> Iterator[DescentState]:
    """States after each further round, up to the number of the scheme."""
    while state.n < problem.scheme.rounds:
        yield (state := one_round(problem, state))


def one_round(problem: JointProblem, state: DescentState) -> DescentState:
    """The state after one more round: its opening, then a joint step."""
    start = time.perf_counter()
    weights = problem.schedule.at(state.n, state.statistics)
    opening = openings(problem.scheme.rounds)[state.n]
    u, w, labels = state.u, state.w, state.labels
    if isinstance(opening, RestartRegions):
        u, w, labels = _restarted(problem, state, weights)
    else:
        if opening is not None:
            u, w, labels = _edges_localised(problem, state, opening, weights)
        u, w = _joint(problem, state.n, u, w, labels, weights)
    final = problem.schedule.final(state.statistics)
    value, residual = cost(problem, u, w, final)
    done = JointRound(
        state.n, f"{opening.label} + joint" if opening else "joint", value, residual,
        float(np.abs(w - state.w).mean()), time.perf_counter() - start, weights,
    )  # fmt: skip
    return DescentState(state.n + 1, u, w, _statistics(problem, u, w, weights), (*state.history, done), labels)


def _joint(
    problem: JointProblem, n: int, u: Array, w: Array, labels: Labels | None, weights: PriorWeights,
    active: Mask | None = None,
) -> tuple[Array, Array]:  # fmt: skip
    """Picture and depth after a joint Gauss-Newton step in round n, of `active` pixels if given."""
    early = n < int(CONSTANT * problem.scheme.rounds)  # under strong priors half of the iterations suffice
    iterations = (problem.scheme.picture + problem.scheme.depth) // (2 if early else 1)
    problem.data.focus(w)
    edges = _edges(problem, problem.data.residual(u) if n else None, w, weights, labels)
    return joint_step(problem.data, u, w, weights, iterations, _diffusion(problem, u), edges, active)


def _restarted(problem: JointProblem, state: DescentState, weights: PriorWeights) -> tuple[Array, Array, Labels]:
    """Picture, depth and segments after some joint steps, with unexplained regions restarted."""

    def onward(pair: RegionAttempt, active: Mask | None) -> RegionAttempt:
        for _ in range(ON_TRIAL):
            u, w = _joint(problem, state.n, pair.u, pair.w, pair.labels, weights, active)
            pair = RegionAttempt(u, w, pair.labels)
        return pair

    old = RegionAttempt(state.u, state.w, segments(state.w, EDGE_MARGIN, state.labels))
    iterations = problem.edges.iterations
    pair = restart(problem.data, problem.other, old, problem.reach, weights.picture, onward, iterations)
    return pair.u, pair.w, pair.labels


def _edges_localised(
    problem: JointProblem, state: DescentState, step: PlaceEdges, weights: PriorWeights
) -> tuple[Array, Array, Labels]:
    """Picture, depth and segments with localised depth edges, over a wide or a narrow band."""
    reach, margin = (step.reach, step.margin) if step.reach is not None else (problem.reach, problem.reach - 1)
    labels = segments(state.w, margin, state.labels)
    w = remove_blemishes(state.w, labels, margin) if step.far else state.w
    # in a wide band only where the first depth did not fit
    where = problem.misfit if step.far else None
    layers = layers_of(w, labels, reach, margin, rank=step.layers, where=where)
    soft = max(weights.picture, step.softness)
    return place_steps(problem.data, problem.other, state.u, w, labels, layers, soft, step.decided, problem.edges)


def _statistics(problem: JointProblem, u: Array, w: Array, weights: PriorWeights) -> Statistics:
    """Noise, at most 1.5 times the first estimate, which no picture at any depth explains, and contrast of a round; the
    data term is focused on w."""
    R, stacks = problem.data.R, [blur.stack for blur in problem.data.blurs]
    e = problem.data.residual(u)
    inside, downhill = (one[:, R:-R, R:-R].astype(np.float64) for one in (u, problem.data.blur_adjoint(e)))
    depths, fitted = np.quantile(w[R:-R, R:-R], DECILES), depth_freedom(problem.data, u, weights)
    powers = band_powers(e.astype(np.float64)), gradient_powers(inside)
    estimate = moments(stacks, depths, effective_weights(inside, downhill), *powers, fitted)
    sigma, deciding = (min(float(np.sqrt(v)), 1.5 * problem.sigma) for v in (estimate.noise, estimate.deciding))
    return Statistics(sigma, deciding, estimate.contrast)


def picture_alone(
    problem: JointProblem, state: DescentState, progress: Callable[[JointRound], None] | None = None
) -> DescentState:
    """The state of a scene of known w: alternating picture and statistics, then the final picture."""
    for _ in range(4):
        weights = problem.schedule.final(state.statistics)
        iterations = problem.scheme.picture + problem.scheme.depth
        u = restore_picture(problem.data, state.u, weights.picture, iterations, _diffusion(problem, state.u))
        state = replace(state, u=u, statistics=_statistics(problem, u, state.w, weights))
    done = finish(problem, state)
    if progress:
        progress(done.history[-1])
    return done


def finish(problem: JointProblem, state: DescentState) -> DescentState:
    """The picture alone at the final depth, with the final weight: N_TV times N_u iterations."""
    start = time.perf_counter()
    weights = problem.schedule.final(state.statistics)
    problem.data.focus(state.w)
    u = state.u
    for _ in range(problem.scheme.final_rounds):
        u = restore_picture(problem.data, u, weights.picture, problem.scheme.final, _diffusion(problem, u))
    value, residual = cost(problem, u, state.w, weights)
    done = JointRound(state.n, "picture", value, residual, 0.0, time.perf_counter() - start, weights)
    return replace(state, u=u, history=(*state.history, done))


def run(
    problem: JointProblem, state: DescentState, progress: Callable[[JointRound], None] | None = None
) -> DescentState:
    """All remaining rounds and the final picture, from the best pair."""
    best = last = state
    for last in rounds(problem, state):
        if progress:
            progress(last.history[-1])
        # costs are comparable under one pair of weights only
        weights = problem.schedule.final(last.statistics)
        if cost(problem, last.u, last.w, weights)[0] <= 1.05 * cost(problem, best.u, best.w, weights)[0]:
            best = last
    done = finish(problem, replace(best, n=last.n, history=last.history))
    if progress:
        progress(done.history[-1])
    return done


# --- restart of regions that a restoration does not explain, from the depths around them ---
# Descent does not leave a region whose depth belongs to the wrong surface: it bends that surface until the photographs
# nearly fit, and picture and depth are wrong together. Its residual exceeds the noise. Such regions are restarted from
# the surfaces extrapolated into them from where the photographs fit, and the edges between these are localised again.
# After a few rounds each place keeps the version with the smaller residual.

WINDOW = 7
"""Side of the window in which the residual is compared with the rest of the frame, pixels."""
UNEXPLAINED = 1.7
"""Mean square residual, relative to the frame's median, above which a window is unexplained: noise alone varies by
0.15."""
LEAST_PART, MOST = 30, 0.2
"""Smallest number of pixels of a region, and largest fraction of the frame: without noise, errors of one region affect
a wide surrounding."""
LEAST_SEGMENT, LEAST_EXPLAINED = 40, 0.3
"""Smallest number of pixels and fraction of a segment that must be explained; otherwise it is a blemish."""
EDGE_MARGIN = 2
"""Pixels about a border whose depth is ignored."""
SOFT = 1e-4
"""Smallest weight of the picture's prior at the start of a region."""
ROUNDS = 8
"""Rounds of edge localisation, twice as many as elsewhere, as they start undecided."""


@dataclass(frozen=True)
class RegionAttempt:
    """Picture (C, H', W'), depth and segments (H', W') of one attempt."""

    u: Array
    w: Array
    labels: Labels


def relative_residual(e: Array) -> Array:
    """Local mean square of the residuals e (P, C, H, W), relative to the frame's median: (H, W)."""
    power = uniform_filter((e**2).mean(axis=(0, 1)), WINDOW)
    return np.asarray(power / max(float(np.median(power)), 1e-20))


def unexplained(data: DataTerm, u: Array) -> Mask:
    """Where the residual is larger than elsewhere, (H', W'); data : focused on the picture's depth."""
    power = relative_residual(data.residual(u))
    wrong = np.pad(power > max(UNEXPLAINED, float(np.percentile(power, 100 * (1 - MOST)))), data.R, mode="edge")
    parts, n = label(wrong)
    large = np.bincount(parts.ravel(), minlength=n + 1) >= LEAST_PART
    large[0] = False
    return np.asarray(binary_dilation(large[parts], iterations=3))


def reliable_segments(labels: Labels, wrong: Mask) -> Labels:
    """Labels without the segments that are nearly all wrong; their pixels join the nearest other segment."""
    count = np.bincount(labels.ravel())
    right = np.bincount(labels[~wrong], minlength=len(count))
    lost = ((right < LEAST_SEGMENT) | (right < LEAST_EXPLAINED * count))[labels]
    if lost.all() or not lost.any():
        return labels
    nearest = distance_transform_edt(lost, return_distances=False, return_indices=True)
    return np.asarray(labels[tuple(nearest)])


def restarted(
    data: DataTerm, other: DataTerm, old: RegionAttempt, wrong: Mask, reach: int, weight: float,
    iterations: int = FULL.iterations,
) -> RegionAttempt:  # fmt: skip
    """The pair with its wrong regions restarted, edges localised within `reach`; the terms remain focused elsewhere."""
    soft = max(weight, SOFT)
    labels = reliable_segments(old.labels, wrong)
    w = np.where(wrong, surfaces(old.w, labels, 0, EDGE_MARGIN, valid=~wrong).surface, old.w).astype(old.w.dtype)
    layers = layers_of(w, labels, reach, EDGE_MARGIN, where=wrong, valid=~wrong)
    layers = replace(layers, share=np.where(layers.band, 0.5, layers.share))
    data.focus(w)
    u = restore_picture(data, np.where(wrong, data.mean(), old.u).astype(old.u.dtype), soft, 15)
    return RegionAttempt(*place_steps(data, other, u, w, labels, layers, soft, effort=Effort(ROUNDS, iterations)))


def better_of(data: DataTerm, old: RegionAttempt, new: RegionAttempt, wrong: Mask) -> RegionAttempt:
    """At every place near the wrong regions the pair with the smaller residual within the masks' reach."""
    residuals = []
    for pair in (old, new):
        data.focus(pair.w)
        power = np.pad((data.residual(pair.u) ** 2).sum(axis=(0, 1)), data.R)
        residuals.append(uniform_filter(power, 2 * data.R + 1))
    take = binary_dilation(wrong, iterations=EDGE_MARGIN) & (residuals[1] < residuals[0])
    return RegionAttempt(
        np.where(take, new.u, old.u), np.where(take, new.w, old.w), np.where(take, new.labels, old.labels)
    )


def restart(
    data: DataTerm, other: DataTerm, old: RegionAttempt, reach: int, weight: float,
    onward: Callable[[RegionAttempt, Mask | None], RegionAttempt], iterations: int = FULL.iterations,
) -> RegionAttempt:  # fmt: skip
    """The pair after some rounds, with regions restarted where that lowers the residual; onward : those rounds, of all
    pixels or of those near the regions.

    See `restarted` for the other parameters.
    """
    data.focus(old.w)
    wrong = unexplained(data, old.u)
    old = onward(old, None)
    if not wrong.any():
        return old
    new = restarted(data, other, old, wrong, reach, weight, iterations)
    around = maximum_filter(wrong, 2 * data.R + 1)
    return better_of(data, old, onward(new, around), wrong)
