"""Motion paths from all depths of the scene: at other depths a path has another size, which gives subpixel accuracy.

A flat part gives the masks to whole pixels (`blind`), which many curves draw equally well. First those that agree with
other depths are selected (`path_pairs`) in a part of the frame that has such depths (`search_window`). Then that part
is restored with them, and they are optimised for the residual (`basin_hopping`), until there is no improvement. Each
restoration starts from the last one's depth.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from procedures.outcome import Outcome, mark_doubtful
from procedures.restoration.first_depth.initial_depth import LEAST_SIGMA, matched
from procedures.restoration.joint.data_term import DataTerm, restore_picture
from procedures.restoration.joint.depth_edges import Effort
from procedures.restoration.joint.estimate import reach_of
from procedures.restoration.joint.gauss_newton import PriorWeights, joint_step
from procedures.restoration.joint.joint_descent import JointProblem, begin, problem_of, run
from procedures.restoration.joint.priors import steps_allowed
from procedures.restoration.joint.schedule import DEPTH_SLOPE, Schedule, Scheme
from procedures.restoration.masks.blur_models import mask_stack, reach
from procedures.restoration.masks.blur_operator import Array, BlurOperator, MaskStack
from procedures.restoration.unknown_motion.basin_hopping import BasinHopping
from procedures.restoration.unknown_motion.blind import Prototypes, Report, counted
from procedures.restoration.unknown_motion.cross_relation import Disagreement
from procedures.restoration.unknown_motion.mask_evidence import (
    UNRELIABLE_TILE,
    EvidenceTile,
    MaskEvidence,
    filters,
    fit_curves,
    gather,
    masks_at,
    unexplained,
)
from procedures.restoration.unknown_motion.motion_splines import basis, candidates, half_width, path_stack, shapes_of
from procedures.restoration.unknown_motion.path_pairs import Search, distinct
from procedures.restoration.unknown_motion.search_window import Window, search_window, within

Box = tuple[int, int, int, int]

TILE = 24
"""Side of the tiles in which the frame is compared with the curves, pixels: the flat part holds at least one."""
LEVEL = 0.05
"""Step of w between the levels of a tile's masks, pixels."""

EDGES = Effort(rounds=2, iterations=20)
"""Effort at edges in the intermediate restorations: each continues the last one, so that edges need not converge."""
MOST_PIXELS, SEARCHED_PIXELS = 120_000, 50_000
"""Pixels of the frame around the flat part whose depth is matched roughly, and of the window in which paths are
searched for: time grows with it, and paths improve slightly."""
CONTRAST = 6.3e-3
"""Expected mean squared difference of neighbours of the picture during the search, white = 1."""
JOINT_STEPS, JOINT_ITERATIONS, PICTURE_ITERATIONS = 5, 18, 20
"""Joint steps of picture and depth after matching (fewer leave the depth less accurate than the curves), conjugate
gradients of each, and of improving the picture alone."""
MATCHED = 6
"""Pairs of curves whose depth is matched."""
MATCHED_DONE, DONE = 0.4, 0.6
"""Fractions of the scheme's rounds that are skipped for a depth that was matched, and restored with other curves: the
first includes restarts of regions, which double the time."""
STEADY = 0.005
"""Relative change of the flat part's masks in a hop below which only picture and depth change."""
LEAST_FALL = 0.003
"""Fall of the residual energy, relative to the noise, below which the search ends."""
ENOUGH = 0.83
"""Residual energy, relative to the noise, below which no other pair is optimised."""
SCHEME = Scheme(10, 20, 20, 2, 10)
"""Scheme of the restorations meanwhile."""
USUAL, MOST = 0.75, 0.87
"""Typical residual energy, relative to the noise, with the true curves, and the value above which they are wrong."""
LEAST_RANGE, REMOTE = 0.5, 2.0
"""Range of w, pixels, below which a scene's depths leave paths undetermined within a pixel, and per cent of the places
with the smallest and the largest w that are not counted."""
REMEDY = "record the rig's motion, or mark a larger flat part with more detail"


@dataclass(frozen=True)
class PathEffort:
    """Effort of the search of motion paths.

    beginnings : starts of each curve. descending, descents : pairs from which descents start, and descents of each with
    renewed evidence. bends : of `BasinHopping`. restored, more : matched pairs with which the frame is restored, and
    maximum number of restorations from the best, by scheme. Nearly all of the time is spent on these.
    """

    beginnings: int = 64
    descending: int = 10
    descents: int = 2
    bends: int = 40
    restored: int = 2
    more: int = 12
    scheme: Scheme = SCHEME


@dataclass(frozen=True)
class MotionShapes:
    """Shapes (P, n, n) on [-1, 1] of the motions, and their half-width in the flat part, pixels.

    path : the curves, (2, n, 2) pixels x, y in the flat part; None where the shapes are known to pixels only.
    caveat : why they are unreliable at other depths, or None; remedy : what to do then. others : kernels of a flat
    scene from another search, or None.
    """

    shapes: Array
    half_width: float
    path: Array | None = None
    caveat: str | None = None
    remedy: str = REMEDY
    others: Array | None = None

    def judged(self, outcome: Outcome[Any]) -> Outcome[Any]:
        """A restoration with these shapes, doubtful if they are."""
        return outcome if self.caveat is None else mark_doubtful(outcome, self.caveat, self.remedy)


@dataclass(frozen=True)
class _View:
    """Data of the fit: photographs (2, 1, H, W), the flat part and its w, the noise, and the effort."""

    z: Array
    flat: tuple[slice, slice]
    half: float
    max_w: float
    effort: PathEffort
    sigma: float = LEAST_SIGMA

    @property
    def R(self) -> int:
        return int(np.ceil(self.max_w + 0.5))

    @property
    def noisy(self) -> bool:
        """Whether the error of matched depths exceeds what the rest of a restoration's scheme corrects."""
        return self.sigma > 2 * LEAST_SIGMA

    @property
    def weights(self) -> PriorWeights:
        """Weights of the priors of picture and depth."""
        return PriorWeights(self.sigma**2 / CONTRAST, self.sigma**2 / DEPTH_SLOPE**2)

    def pinned(self, w: Array) -> Array:
        """Depth (H, W) with that of the flat part fixed."""
        w = np.array(w, dtype=np.float64)
        w[self.flat] = self.half
        return w

    def cut(self, window: Window) -> "_View":
        """A part of these rows and columns."""
        return replace(self, z=self.z[:, :, *window], flat=within(self.flat, window))

    def data(self, stacks: list[MaskStack]) -> DataTerm:
        shape = (self.z.shape[2], self.z.shape[3])
        trust = np.ones((2, 1, *shape), np.float32)
        return DataTerm(self.z.astype(np.float32), [BlurOperator(s, shape, np.float32) for s in stacks], trust)

    def stacks(self, points: Array) -> list[MaskStack]:
        return [path_stack(point, self.half, self.max_w, self.R) for point in points]

    def depth(self, stacks: list[MaskStack]) -> Array:
        """A first depth (H, W) for these masks."""
        sigma = self.sigma if self.noisy else LEAST_SIGMA
        return self.pinned(matched(self.z, stacks, np.full(2, sigma)).w)


@dataclass(frozen=True)
class _Fit:
    """State of the fit: points (2, POINTS, 2), depth (H, W), picture (1, H + 2R, W + 2R), residual energy.

    evidence : of the frame on the masks.
    """

    points: Array
    w: Array
    u: Array
    energy: float = np.inf
    evidence: tuple[MaskEvidence, ...] = ()


def motion_of_scene(
    photographs: list[Array],
    region: Box,
    prototypes: Prototypes,
    max_w: float,
    rng: np.random.Generator,
    known: Array | None = None,
    effort: PathEffort | None = None,
    report: Report | None = None,
) -> MotionShapes:
    """Subpixel shapes for every depth, from those of a flat part, x, y, width, height, and the surrounding frame.

    photographs : two arrays (C, H, W); prototypes : `blind.prototype_shapes` of the part; known : initial control
    points (2, POINTS, 2), pixels in the flat part, if roughly known. If no path explains the frame better than masks
    to whole pixels, those are returned, with the caveat.
    """
    if min(region[2:]) < TILE:
        return MotionShapes(
            prototypes.shapes, prototypes.half_width, None, f"the flat part is narrower than {TILE} pixels"
        )
    view = _view(photographs, region, prototypes.half_width - 0.4, max_w, effort or PathEffort())
    view, coarse = _pixels(view, prototypes)
    fit = _settled(view, prototypes, known, rng, report)
    if fit.energy > coarse:
        return MotionShapes(
            prototypes.shapes, prototypes.half_width, None, "motion is known to whole pixels only: no path fits"
        )
    return _judged(fit, recorded=known is not None)


def _judged(fit: _Fit, *, recorded: bool) -> MotionShapes:
    """The paths of a fit, with a caveat where it does not determine them."""
    shapes, half, paths = shapes_of(fit.points), half_width(fit.points), basis() @ fit.points
    if fit.energy > MOST:
        residual = f"the motion's paths leave {fit.energy:.2f} of the noise unexplained; {USUAL} is typical"
        return MotionShapes(shapes, half, paths, residual)
    low, high = np.percentile(fit.w, (REMOTE, 100 - REMOTE))
    if not recorded and high - low < LEAST_RANGE:
        flat = f"paths are known to pixels only, as w differs by {high - low:.2f} pixels at most: the scene is flat"
        return MotionShapes(shapes, half, paths, flat, "restore it as a flat scene, or record the rig's motion")
    return MotionShapes(shapes, half, paths)


def _view(photographs: list[Array], region: Box, half: float, max_w: float, effort: PathEffort) -> _View:
    x, y, width, height = region
    H, W = photographs[0].shape[1:]
    margin = max(H, W)

    def pixels() -> int:
        rows = min(H, y + height + margin) - max(0, y - margin)
        columns = min(W, x + width + margin) - max(0, x - margin)
        return int(rows * columns)

    while pixels() > MOST_PIXELS:
        margin -= 8
    top, left = max(0, y - margin), max(0, x - margin)
    part = (slice(top, y + height + margin), slice(left, x + width + margin))
    z = np.stack([p.mean(axis=0)[part] for p in photographs])[:, None]
    flat = (slice(y - top, y - top + height), slice(x - left, x - left + width))
    return _View(z, flat, half, max(max_w, 1.2 * half), effort)


def _pixels(view: _View, prototypes: Prototypes) -> tuple[_View, float]:
    """The part of the view that is used, with its noise, and the energy unexplained by masks to whole pixels."""
    widest = view.max_w * prototypes.half_width / view.half
    stacks = [mask_stack(s, widest, R=max(view.R + 1, reach(widest))) for s in prototypes.shapes]
    coarse = replace(view, half=prototypes.half_width, max_w=stacks[0].max_w - 2 * stacks[0].step)
    w = coarse.depth(stacks)
    window = search_window(view.z, view.flat, coarse.half, w, SEARCHED_PIXELS)
    view, coarse, w = view.cut(window), coarse.cut(window), w[window]
    R = stacks[0].R
    e = _errors(coarse, stacks, w, np.pad(view.z.mean(axis=0), ((0, 0), (R, R), (R, R)), mode="edge"))[1]
    errors = [(flat, float(r @ r) / TILE**2) for flat, r in _unexplained(coarse, stacks, w, e)]
    sigma = float(np.sqrt(np.median([m for flat, m in errors if flat])))
    return replace(view, sigma=sigma), _energy([m / sigma**2 for _, m in errors])


def _origins(points: Array) -> list[Array]:
    """Candidate offsets in whole pixels, to which masks are known, of the paths' origin from the masks' centre: at
    their mean, or between extremes."""
    paths = basis() @ points
    ends = (paths.min(axis=(0, 1)) + paths.max(axis=(0, 1))) / 2
    each = [np.round(at) for at in (paths.mean(axis=(0, 1)), ends)]
    return each[:1] if (each[0] == each[1]).all() else each


def _starts(
    view: _View, prototypes: Prototypes, known: Array | None, pools: list[list[Array]]
) -> tuple[list[Array], list[list[Array]]]:
    """Pairs of curves that draw the flat part's masks and that the surrounding frame contradicts least, and the
    distinct curves of the pools."""
    points = known
    if points is None:
        points = np.stack([_nearest(pool, mask) for pool, mask in zip(pools, prototypes.masks, strict=True)])
    points, evidence = _of_flat_part(view, points)
    curves = [distinct(evidence, points, view.half, k, pool) for k, pool in enumerate(pools)]
    w = view.depth(view.stacks(points))
    around = Disagreement(view.z[:, 0] / view.sigma, view.flat, view.half, w)
    search = Search(around, evidence, view.effort.descents)
    starts = [pair.points for pair in search.starts(curves)[: view.effort.descending]] if pools else [points]
    return [pair.points for pair in search.best(starts)[:MATCHED]], curves


def _nearest(pool: list[Array], mask: Array) -> Array:
    R = len(mask) // 2
    return min(pool, key=lambda curve: float(np.sum((masks_at(curve[None], 1.0, 1.0, R)[0] - mask) ** 2)))


def _of_flat_part(view: _View, points: Array) -> tuple[Array, tuple[MaskEvidence, ...]]:
    """Curves fitted to the flat part alone, and its evidence on the masks."""
    part = view.cut(view.flat)
    fit = _fresh(part, points, np.full(part.z.shape[2:], view.half))
    for _ in range(2):
        stacks = part.stacks(fit.points)
        for _ in range(2):
            fit = replace(fit, u=_errors(part, stacks, fit.w, fit.u)[0])
        fit = _evidence(part, fit, stacks)
        fit = replace(fit, points=fit_curves(fit.evidence, fit.points, view.half)[1])
    return fit.points, fit.evidence


def _settled(
    view: _View, prototypes: Prototypes, known: Array | None, rng: np.random.Generator, report: Report | None
) -> _Fit:
    s, pools = view.effort, []
    if known is None:
        pools = [candidates(mask, prototypes.half_width - 0.5, rng, s.beginnings) for mask in prototypes.masks]
    pairs, curves = _starts(view, prototypes, known, pools)
    hopping = BasinHopping(curves, rng, s.bends)
    starts = [(points - by, by) for points in pairs for by in _origins(points)]
    step = counted(report, len(starts) + min(s.restored, len(starts)) * (1 + s.more))
    matched, tried = [], []
    for points, by in starts:
        matched.append((_matched(view, points), hopping.about_origin(by)))
        step()
    for fit, those in sorted(matched, key=lambda each: each[0].energy)[: s.restored]:
        tried.append((_hop(view, _restored(view, fit.points, fit, 0 if view.noisy else MATCHED_DONE), those), those))
        step()
    ends: list[_Fit] = []
    for fit, those in sorted(tried, key=lambda each: each[0].energy):
        ends.append(_hop_repeatedly(view, fit, those, step))
        if view.noisy or ends[-1].energy < ENOUGH:  # with strong noise the best has a larger energy, too
            break
    return min(ends, key=lambda fit: fit.energy)


def _hop_repeatedly(view: _View, fit: _Fit, hopping: BasinHopping, step: Callable[[], object]) -> _Fit:
    """Basin hopping until there is no improvement: few starts while the energy falls, all before the end.

    It ends as well where the energy is that of true curves and they do not move: only picture and depth improve."""
    few = hopping.fewer()
    tried = few
    for _ in range(view.effort.more):
        other = _hop(view, fit, tried)
        step()
        before, after = (masks_at(each.points, view.half, view.half, view.R) for each in (fit, other))
        falls = other.energy < fit.energy - LEAST_FALL
        steady = not falls or np.linalg.norm(after - before) < STEADY * np.linalg.norm(before)
        fit = min(fit, other, key=lambda each: each.energy)
        if (steady and fit.energy < ENOUGH) or (not falls and tried is hopping):
            break
        tried = few if falls else hopping
    return fit


def _fresh(view: _View, points: Array, w: Array) -> _Fit:
    R = view.R
    return _Fit(points, w, np.pad(view.z.mean(axis=0), ((0, 0), (R, R), (R, R)), mode="edge").astype(np.float32))


def _matched(view: _View, points: Array) -> _Fit:
    """A fit with the depth matched by the curves' masks, refined by a few joint steps."""
    stacks = view.stacks(points)
    fit = _fresh(view, points, view.depth(stacks))
    for _ in range(2):
        fit = replace(fit, u=_errors(view, stacks, fit.w, fit.u)[0])
    R, weights = view.R, view.weights
    inside = (slice(R, -R), slice(R, -R))
    data = view.data(stacks)
    u, wide = fit.u, np.pad(fit.w, R, mode="edge").astype(np.float32)
    for _ in range(JOINT_STEPS):
        edges = steps_allowed(wide, weights.step)
        u, wide = joint_step(data, u, wide, weights, JOINT_ITERATIONS, (1.0, 1.0), edges)
        wide[inside] = view.pinned(wide[inside])
    w = wide[inside].astype(np.float64)
    u, e = _errors(view, stacks, w, u)
    errors = [float(r @ r) / (TILE * view.sigma) ** 2 for _, r in _unexplained(view, stacks, w, e)]
    return replace(fit, u=u, w=w, energy=_energy(errors))


def _restored(view: _View, points: Array, start: _Fit, done: float) -> _Fit:
    """A fit with the picture and depth of a restoration from `start`, `done` of the scheme skipped, and its evidence on
    the masks."""
    stacks, R, scheme = view.stacks(points), view.R, view.effort.scheme
    data, other = problem_of(view.z, stacks, np.ones((2, 1, *view.z.shape[2:])), np.float32)
    w = view.pinned(start.w)
    problem = JointProblem(data, other, scheme, Schedule(scheme.rounds), view.sigma, reach_of(w, stacks), edges=EDGES)
    state = run(problem, replace(begin(problem, w), n=int(done * scheme.rounds)))
    w = view.pinned(state.w[R:-R, R:-R])
    return _evidence(view, _Fit(points, w, state.u), stacks)


def _hop(view: _View, fit: _Fit, hopping: BasinHopping) -> _Fit:
    """The frame restored again with the best curves of basin hopping from those of a fit."""
    return _restored(view, hopping.minimise(fit.evidence, fit.points, view.half), fit, DONE)


def _errors(view: _View, stacks: list[MaskStack], w: Array, u: Array) -> tuple[Array, Array]:
    """The picture improved for masks and depth, and the photographs' errors (2, H, W)."""
    data = view.data(stacks)
    data.focus(np.pad(w, data.R, mode="edge").astype(np.float32))
    u = restore_picture(data, u.astype(np.float32), view.weights.picture, PICTURE_ITERATIONS)
    return u, data.residual(u)[:, 0].astype(np.float64)


def _tiles(view: _View) -> Iterator[tuple[bool, tuple[slice, slice]]]:
    """Tiles of the frame, aligned to the flat part, and whether each lies in it."""
    rows, columns = view.flat
    H, W = view.z.shape[2:]
    for y in _tile_starts(rows.start, H):
        for x in _tile_starts(columns.start, W):
            inside = rows.start <= y <= rows.stop - TILE and columns.start <= x <= columns.stop - TILE
            yield inside, (slice(y, y + TILE), slice(x, x + TILE))


def _tile_starts(start: int, length: int) -> list[int]:
    """First pixels of tiles: aligned to `start`, and at both ends of the frame where much would be missed."""
    aligned = list(range(start % TILE, length - TILE + 1, TILE))
    first = [0] if aligned[0] > TILE // 4 else []
    last = [length - TILE] if length - TILE - aligned[-1] > TILE // 4 else []
    return first + aligned + last


def _level(w: Array) -> float:
    return max(round(float(np.median(w)) / LEVEL) * LEVEL, 0.3)


def _evidence(view: _View, fit: _Fit, stacks: list[MaskStack]) -> _Fit:
    """The fit with its picture improved, the evidence on the masks of every level of w, and the residual energy."""
    u, e = _errors(view, stacks, fit.w, fit.u)
    tiles: dict[float, list[EvidenceTile]] = {}
    for flat, (y, x) in _tiles(view):
        level = view.half if flat else _level(fit.w[y, x])
        around = u[0, y.start : y.stop + 2 * view.R, x.start : x.stop + 2 * view.R]
        tiles.setdefault(level, []).append(EvidenceTile(e[:, y, x] / view.sigma, around / np.float32(view.sigma), flat))
    evidences, errors, delta = [], [], 0.05
    for w, those in sorted(tiles.items()):
        evidence = MaskEvidence.about(fit.points, view.half, w, view.R)
        above, below = (masks_at(fit.points, view.half, w + d, evidence.R) for d in (delta, -delta))
        errors += gather(evidence, (above - below) / (2 * delta), those)
        evidences.append(evidence)
    return replace(fit, u=u, energy=_energy(errors), evidence=tuple(evidences))


def _unexplained(view: _View, stacks: list[MaskStack], w: Array, e: Array) -> Iterator[tuple[bool, Array]]:
    """Errors of every tile that no common picture explains, and whether it lies in the flat part."""
    for flat, (y, x) in _tiles(view):
        masks = np.stack([s.at(_level(w[y, x])) for s in stacks])
        yield flat, unexplained(e[:, y, x], filters(masks, TILE))


def _energy(errors: list[float]) -> float:
    """Mean of the tiles' mean squares, relative to the noise, with reduced weight of those with a depth edge."""
    return float(np.mean(UNRELIABLE_TILE * np.log1p(np.array(errors) / UNRELIABLE_TILE)))
