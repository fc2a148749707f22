"""Motion paths from every depth of the scene: other depths show a path at other sizes, and so between the pixels.

A flat part gives the masks to whole pixels (`blind`), which many curves draw equally well. Here the curves are fitted
to the photographs around it by Gauss-Newton: whatever a common picture can explain is projected out, tile by tile
(z1 * h2 = z2 * h1 in the errors), and so is a change of each tile's depth; what is left belongs to the paths.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from procedures.outcome import Outcome, Verdict
from procedures.restoration.blind import Prototypes
from procedures.restoration.blur_models import LINE, mask_stack
from procedures.restoration.cost import DataTerm, restore_picture
from procedures.restoration.depth import matched
from procedures.restoration.estimate import LEAST_START_SIGMA
from procedures.restoration.forward import Array, Blur, MaskStack
from procedures.restoration.newton import Weights, joint_step
from procedures.restoration.paths import (
    POINTS,
    basis,
    bending,
    drawn,
    drawn_change,
    half_width,
    path_stack,
    redrawn,
    search,
    shapes_of,
)
from procedures.restoration.priors import steps_allowed
from procedures.restoration.scheme import DEPTH_SLOPE

Box = tuple[int, int, int, int]

TILE = 24
# most pixels of the frame that are looked at: beyond, more of them make the paths no better, but slower
MOST = 120_000
# levels of w for which a tile's masks are made, pixels
LEVEL = 0.1
# a path's control point moves so far at most in one step, and is expected to move, pixels
LONGEST, USUAL = 0.3, 0.2
# weight of a curve's mean squared acceleration in squared noise: of those that fit alike the least bent is taken
BEND = 1e-3
# mean squared error of a tile, of noise 1, beyond which a depth step or a wrong depth is rather in it
DOUBT = 10.0
# from coarse to fine: blur of the errors, pixels; then anew from a redrawn curve
FIRST = ((0.7, 100), (0.7, 100), (0.5, 50), (0.2, 30), (0.0, 20))
AGAIN = ((0.4, 30), (0.0, 20))
REDRAWN = 4
# and with the depths improved beside the paths
LAST = 4

# mean squared difference of neighbours expected of the picture while paths are sought, white = 1
CONTRAST = 6.3e-3
# unexplained error beside the noise's beyond which the curves are not those of the rig, and below which they are
MOST_LEFT, LITTLE_LEFT = 1.0, 0.7
REMEDY = "record the rig's motion, or mark a larger flat part with more detail"


@dataclass(frozen=True)
class MotionShapes:
    """Shapes (2, n, n) on [-1, 1] of two motions, their half-width in the flat part, pixels.

    path : the curves found, (2, n, 2) pixels x, y in the flat part; None where the shapes are known to pixels only.
    doubt : why they are not to be trusted at other depths, or None.
    """

    shapes: Array
    half_width: float
    path: Array | None = None
    doubt: str | None = None

    def judged(self, outcome: Outcome[Any]) -> Outcome[Any]:
        """A restoration with these shapes: doubtful where they are, if nothing else was wrong."""
        if self.doubt is None or outcome.verdict is not Verdict.PASS:
            return outcome
        return Outcome(outcome.value, Verdict.DOUBTFUL, self.doubt, REMEDY)


@dataclass(frozen=True)
class _View:
    """What paths are fitted to: photographs (2, 1, H, W), the flat part and its w, and the noise."""

    z: Array
    flat: tuple[slice, slice]
    half: float
    max_w: float
    sigma: float = LEAST_START_SIGMA

    @property
    def R(self) -> int:
        return int(np.ceil(self.max_w + 0.5))

    @property
    def weights(self) -> Weights:
        """Of the priors of picture and depth."""
        return Weights(self.sigma**2 / CONTRAST, self.sigma**2 / DEPTH_SLOPE**2)

    def pinned(self, w: Array) -> Array:
        """Depth (H, W) with the flat part at its own w."""
        w = np.array(w, dtype=np.float64)
        w[self.flat] = self.half
        return w

    def data(self, stacks: list[MaskStack]) -> DataTerm:
        shape = (self.z.shape[2], self.z.shape[3])
        trust = np.ones((2, 1, *shape), np.float32)
        return DataTerm(self.z.astype(np.float32), [Blur(s, shape, np.float32) for s in stacks], trust)

    def stacks(self, points: Array) -> list[MaskStack]:
        return [path_stack(one, self.half, self.max_w, self.R) for one in points]

    def depth(self, stacks: list[MaskStack]) -> Array:
        """A first depth (H, W) for these masks."""
        return self.pinned(matched(self.z, stacks, np.full(2, LEAST_START_SIGMA)).w)


@dataclass(frozen=True)
class _Fit:
    """Where the fit stands: points (2, POINTS, 2), depth (H, W), picture (1, H + 2R, W + 2R), what is left."""

    points: Array
    w: Array
    u: Array
    energy: float = np.inf


def motion_of_scene(
    photographs: list[Array],
    region: Box,
    found: Prototypes,
    max_w: float,
    rng: np.random.Generator,
    begun: Array | None = None,
) -> MotionShapes:
    """Shapes fine enough for every depth, from those found in a flat part, x, y, width, height, and the frame around.

    photographs : two arrays (C, H, W); found : `blind.prototype_shapes` of the part; begun : control points
    (2, POINTS, 2) to begin from, pixels in the flat part, if they are known roughly. Where no curves explain the frame
    better than the masks to whole pixels, those are given back, with the doubt.
    """
    if min(region[2:]) < TILE:
        return MotionShapes(found.shapes, found.half_width, None, f"the flat part is narrower than {TILE} pixels")
    if begun is None:
        begun = np.stack([search(mask, found.half_width - 0.5, rng) for mask in found.masks])
    view = _view(photographs, region, found.half_width - 0.4, max_w)
    view, coarse = _pixels(view, found)
    fit = min((_from_afar(view, begun - by) for by in _origins(begun)), key=lambda one: one.energy)
    fit = _with_depths(view, fit, 3)
    for n in range(REDRAWN):
        if fit.energy < LITTLE_LEFT:
            break
        points = fit.points.copy()
        points[n % 2] = redrawn(points[n % 2], rng)
        other = _with_depths(view, _again(view, replace(fit, points=points)), 2)
        fit = min(fit, other, key=lambda one: one.energy)
    fit = min(fit, _with_depths(view, fit, LAST), key=lambda one: one.energy)
    if fit.energy > coarse:
        return MotionShapes(found.shapes, found.half_width, None, "motion is known to whole pixels only: no path fits")
    doubt = f"the motion's paths leave {1 + fit.energy:.1f} times the noise" if fit.energy > MOST_LEFT else None
    return MotionShapes(shapes_of(fit.points), half_width(fit.points), basis() @ fit.points, doubt)


def _view(photographs: list[Array], region: Box, half: float, max_w: float) -> _View:
    """The frame about the flat part, as much of it as is looked at."""
    x, y, width, height = region
    H, W = photographs[0].shape[1:]
    margin = max(H, W)
    while (min(H, y + height + margin) - max(0, y - margin)) * (min(W, x + width + margin) - max(0, x - margin)) > MOST:
        margin -= 8
    top, left = max(0, y - margin), max(0, x - margin)
    part = (slice(top, y + height + margin), slice(left, x + width + margin))
    z = np.stack([p.mean(axis=0)[part] for p in photographs])[:, None]
    flat = (slice(y - top, y - top + height), slice(x - left, x - left + width))
    return _View(z, flat, half, max(max_w, 1.2 * half))


def _pixels(view: _View, found: Prototypes) -> tuple[_View, float]:
    """The view with its noise, and what masks known to whole pixels leave unexplained of it."""
    stacks = [mask_stack(s, view.max_w * found.half_width / view.half, R=view.R + 1) for s in found.shapes]
    coarse = replace(view, half=found.half_width, max_w=stacks[0].max_w - 2 * stacks[0].step)
    w = coarse.depth(stacks)
    R = stacks[0].R
    e = _errors(coarse, stacks, w, np.pad(view.z.mean(axis=0), ((0, 0), (R, R), (R, R)), mode="edge"))[1]
    left = [(flat, float(np.mean(r**2))) for flat, r in _left(coarse, stacks, w, e)]
    sigma = float(np.sqrt(np.median([m for flat, m in left if flat])))
    return replace(view, sigma=sigma), _energy([m / sigma**2 for _, m in left])


def _origins(points: Array) -> list[Array]:
    """Whole pixels by which the paths' origin may lie beside the masks' middle: at their means, or between extremes.

    Masks of whole pixels keep the fractions of a pixel, so that whole ones are all that is to be found.
    """
    paths = basis() @ points
    ends = (paths.min(axis=(0, 1)) + paths.max(axis=(0, 1))) / 2
    each = [np.round(at) for at in (paths.mean(axis=(0, 1)), ends)]
    return each[:1] if (each[0] == each[1]).all() else each


def _from_afar(view: _View, points: Array) -> _Fit:
    """Curves fitted to the frame from those of the flat part alone."""
    R = view.R
    u = np.pad(view.z.mean(axis=0), ((0, 0), (R, R), (R, R)), mode="edge").astype(np.float32)
    return _rounds(view, _Fit(points, np.zeros(view.z.shape[2:]), u), FIRST)


def _rounds(view: _View, fit: _Fit, rounds: tuple[tuple[float, float], ...]) -> _Fit:
    """Depth matched anew with the curves' masks, then two steps of the curves, for each blur of the errors."""
    for n, (soft, doubt) in enumerate(rounds):
        fit = replace(fit, w=view.depth(view.stacks(fit.points)))
        for _ in range(2):
            fit = _step(view, fit, soft, doubt, max(BEND, 0.1 * 0.5**n))
    return _judged(view, fit)


def _again(view: _View, fit: _Fit) -> _Fit:
    """Curves fitted from coarse to fine, at the depths found."""
    for soft, doubt in AGAIN:
        for _ in range(2):
            fit = _step(view, fit, soft, doubt, BEND)
    return _judged(view, fit)


def _with_depths(view: _View, fit: _Fit, rounds: int) -> _Fit:
    """Curves and depths improved in turn."""
    weights = view.weights
    R = view.R
    for _ in range(rounds):
        data = view.data(view.stacks(fit.points))
        u, wide = fit.u, np.pad(fit.w, R, mode="edge").astype(np.float32)
        inside = (slice(R, -R), slice(R, -R))
        for _ in range(2):
            u, wide = joint_step(data, u, wide, weights, 18, (1.0, 1.0), steps_allowed(wide, weights.step))
            wide[inside] = view.pinned(wide[inside])
        fit = replace(fit, u=u, w=wide[inside].astype(np.float64))
        for _ in range(2):
            fit = _step(view, fit, 0.0, DOUBT, BEND)
    return _judged(view, fit)


# ---- one step


def _errors(view: _View, stacks: list[MaskStack], w: Array, u: Array) -> tuple[Array, Array]:
    """The picture improved for masks and depth, and the photographs' errors (2, H, W)."""
    data = view.data(stacks)
    data.focus(np.pad(w, data.R, mode="edge").astype(np.float32))
    u = restore_picture(data, u.astype(np.float32), view.weights.picture, 20)
    return u, data.residual(u)[:, 0].astype(np.float64)


def _tiles(view: _View) -> Iterator[tuple[bool, tuple[slice, slice]]]:
    """Tiles of the frame, in step with the flat part, and whether each lies in it."""
    rows, columns = view.flat
    H, W = view.z.shape[2:]
    for y in range(rows.start % TILE, H - TILE + 1, TILE):
        for x in range(columns.start % TILE, W - TILE + 1, TILE):
            inside = rows.start <= y <= rows.stop - TILE and columns.start <= x <= columns.stop - TILE
            yield inside, (slice(y, y + TILE), slice(x, x + TILE))


def _level(w: Array) -> float:
    """The level that stands for a tile's depths."""
    return max(round(float(np.median(w)) / LEVEL) * LEVEL, 0.3)


def _filters(masks: list[Array], soft: float) -> Array:
    """What takes from both errors of a tile whatever a common picture explains, (2, TILE, TILE // 2 + 1).

    (e1 * h2 - e2 * h1) over the root of its noise's spectrum: of white errors one half is left, white.
    """
    R = len(masks[0]) // 2
    offsets = np.arange(-R, R + 1) % TILE
    wrapped = np.zeros((2, TILE, TILE))
    for out, mask in zip(wrapped, masks, strict=True):
        np.add.at(out, np.ix_(offsets, offsets), mask)
    first, second = np.fft.rfft2(wrapped)
    f = np.fft.fftfreq(TILE)[:, None] ** 2 + np.fft.rfftfreq(TILE) ** 2
    gain = np.exp(-2 * (np.pi * soft) ** 2 * f) / np.sqrt(np.abs(first) ** 2 + np.abs(second) ** 2 + 1e-3)
    return np.stack([second * gain, -first * gain])


def _filtered(tiles: Array, filters: Array) -> Array:
    """Tiles (..., TILE, TILE) through one filter, as rows (..., TILE^2)."""
    out = np.fft.irfft2(np.fft.rfft2(tiles) * filters, (TILE, TILE))
    return np.asarray(out.reshape(*tiles.shape[:-2], -1))


def _left(view: _View, stacks: list[MaskStack], w: Array, e: Array) -> Iterator[tuple[bool, Array]]:
    """What no common picture explains, of every tile, and whether it lies in the flat part."""
    for flat, at in _tiles(view):
        filters = _filters([s.at(_level(w[at])) for s in stacks], 0.0)
        yield flat, _filtered(e[0][at], filters[0]) + _filtered(e[1][at], filters[1])


def _energy(left: list[float]) -> float:
    """Mean of the tiles' mean squares, of noise 1, those with a depth step in them counted little."""
    return float(np.mean(DOUBT * np.log1p(np.array(left) / DOUBT)))


def _judged(view: _View, fit: _Fit) -> _Fit:
    """The fit with what it leaves unexplained."""
    stacks = view.stacks(fit.points)
    u, e = _errors(view, stacks, fit.w, fit.u)
    left = [float(np.mean(r**2)) / view.sigma**2 for _, r in _left(view, stacks, fit.w, e)]
    return replace(fit, u=u, energy=_energy(left))


@dataclass(frozen=True)
class _Level:
    """Masks of one w: filters of a tile's errors, the masks' change with points (2, K^2, 2 POINTS) and w (2, K^2)."""

    filters: Array
    change: Array
    slope: Array


def _masks_at(view: _View, points: Array, w: float, soft: float) -> _Level:
    scale, delta = w / view.half, 0.05
    each = [drawn_change(one * scale, view.R, LINE * w) for one in points]
    slope = [
        (
            drawn(one * (w + delta) / view.half, view.R, LINE * w)
            - drawn(one * (w - delta) / view.half, view.R, LINE * w)
        )
        for one in points
    ]
    filters = _filters([mask for mask, _ in each], soft)
    return _Level(filters, np.stack([J for _, J in each]) * scale, np.stack(slope).reshape(2, -1) / (2 * delta))


def _step(view: _View, fit: _Fit, soft: float, doubt: float, bend: float) -> _Fit:
    """The curves after one Gauss-Newton step; picture and tiles' depths are eliminated from it."""
    u, e = _errors(view, view.stacks(fit.points), fit.w, fit.u)
    levels: dict[float, _Level] = {}
    unknowns = 4 * POINTS
    stiff = np.kron(np.eye(4), bend * bending())
    normal, right = stiff + np.eye(unknowns) / USUAL**2, -stiff @ _column(fit.points)
    for flat, at in _tiles(view):
        w = _level(fit.w[at])
        level = levels.get(w) or levels.setdefault(w, _masks_at(view, fit.points, w, soft))
        r, A, V = (x / view.sigma for x in _linear(view, level, u, e, at))
        weight = 1.0 if flat else 1 / (1 + float(np.mean(r**2)) / doubt) ** 2
        if not flat:
            inner = V @ V.T + np.diag([1e-3, 10.0, 10.0])
            r, A = r - V.T @ np.linalg.solve(inner, V @ r), A - (A @ V.T) @ np.linalg.solve(inner, V)
        normal += weight * A @ A.T
        right += weight * A @ r
    change = np.linalg.solve(normal, right)
    change *= min(1.0, LONGEST / float(np.abs(change).max()))
    return replace(fit, points=fit.points + change.reshape(2, 2, POINTS).swapaxes(1, 2), u=u)


def _column(points: Array) -> Array:
    """Points (2, POINTS, 2) as unknowns: x and y of the first curve, of the second."""
    return np.asarray(points.swapaxes(1, 2).ravel())


def _linear(view: _View, level: _Level, u: Array, e: Array, at: tuple[slice, slice]) -> tuple[Array, Array, Array]:
    """Errors of a tile, and their change with every point (4 POINTS, TILE^2) and with a plane of w (3, TILE^2)."""
    size = 2 * view.R + 1
    wide = (slice(at[0].start, at[0].stop + size - 1), slice(at[1].start, at[1].stop + size - 1))
    around = np.lib.stride_tricks.sliding_window_view(u[0][wide], (size, size))[..., ::-1, ::-1]
    patches = around.reshape(TILE * TILE, -1).astype(np.float64)
    t = (np.arange(TILE) - TILE / 2) / TILE
    planes = np.stack([np.ones((TILE, TILE)), *np.meshgrid(t, t)]).reshape(3, -1)
    r, points, depth = np.zeros(TILE * TILE), [], np.zeros((3, TILE * TILE))
    for one, filters, change, slope in zip(e, level.filters, level.change, level.slope, strict=True):
        r += _filtered(one[at], filters)
        points.append(_filtered((patches @ change).T.reshape(-1, TILE, TILE), filters))
        depth += _filtered((planes * (patches @ slope)).reshape(-1, TILE, TILE), filters)
    return r, np.concatenate(points), depth
