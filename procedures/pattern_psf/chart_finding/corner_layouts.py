"""Sets of saddles in the layout of the chart's twelve x-corners, for any position, size, roll and tilt.

The x-corners are the border of a 4 x 4 lattice. They have one common axis, parallel to an axis of the lattice. Three
equally spaced collinear saddles propose a side; saddles at the other nine points confirm it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.numerics.compiled import compiled, vectorised
from procedures.pattern import BLOCK
from procedures.pattern_psf.chart_finding.marks import SAME_AXIS, Saddles
from procedures.pattern_psf.chart_finding.spatial_bins import Field, alike, all_nearest, bins_within, field_of, nearest

MIN_STEP, MAX_STEP = 16.5, 38.0
"""Range of lattice steps at one level of the pyramid, in its pixels (three blocks of the chart)."""
ALONG_AXIS = np.cos(2 * np.deg2rad(11))
"""Tolerance of the lattice's direction relative to the axes, for shear by tilt and errors of the axes."""
SAME_STRENGTH = 2.5
"""Greatest ratio of strengths within one side: light gradient, noise, focus."""
COLLINEAR = 0.15
"""Greatest distance of a third x-corner from its extrapolation by two, in steps: perspective, distortion."""
MIDDLE_RADIUS = 0.2
"""Radius about the middle of a step, in steps; a finer lattice has a similar saddle there in every step."""
MIN_NEAR, MIN_NEAR_CROWDED = 2, 4
"""Least number of hits of the five x-corners nearest to a triple, without and with a saddle in the middle of one of its
steps, which is common in textures."""
LEVEL_SLOPE = 0.3
"""Slope below which a line is tested in both directions: more than COLLINEAR can turn a step."""
MAX_TRIPLES = 20_000
BIN_SIDE = 12.0
"""Side of the bins of the spatial index, in pixels."""
SQUARE = 0.3
"""Greatest distance of an x-corner from its prediction by a side of a square, in steps: tilt."""
AFFINE = 0.25
PROJECTIVE = 0.15
"""Greatest distances from the predictions by affine and projective lattices, in steps."""
MIN_HITS = 7
"""Least number of visible x-corners of a chart."""
HITS_PER_OCTAVE = 4.0
"""Hits equivalent to twice the strength when layouts are ranked: a chart has the strongest saddles."""
MAX_LAYOUTS = 4000
"""Greatest number of layouts of one picture; textures and lattices have many."""

RIM = np.array([(s, t) for t in range(4) for s in range(4) if s in (0, 3) or t in (0, 3)], dtype=np.float64)
"""Lattice coordinates (s, t) of the twelve x-corners, (12, 2)."""
INSIDE = np.array([(1, 1), (2, 1), (1, 2), (2, 2)], dtype=np.float64)
MOST_INSIDE = 3
"""Similar saddles at the inner lattice points, where a chart has noise, from which on it is a lattice."""
RIM_CELLS = RIM * 3 * BLOCK - BLOCK / 2
"""The x-corners in cells, (12, 2)."""
H_LATTICE_CELLS = np.array([[1, 0, BLOCK / 2], [0, 1, BLOCK / 2], [0, 0, 3 * BLOCK]]) / (3 * BLOCK)
Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]
Indices = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Layouts:
    """Sets of saddles in the layout of a chart's x-corners.

    The orientation, one of the square's eight symmetries, is not determined here.

    Attributes
    ----------
    maps : (n, 3, 3) float64
        Homographies from cells to pixels.
    hits : (n, 12) bool
        Mask of the x-corners that have a saddle, in the order of RIM.
    """

    maps: Array
    hits: npt.NDArray[np.bool_]


@compiled
def _is_step(field: Field, i: int, j: int) -> bool:
    """Whether two similar saddles lie one lattice step apart, parallel or perpendicular to their axis."""
    d = field.points[j] - field.points[i]
    square = d.real * d.real + d.imag * d.imag
    if square <= MIN_STEP * MIN_STEP or square >= MAX_STEP * MAX_STEP:
        return False
    if not alike(field, i, j, SAME_AXIS, SAME_STRENGTH):
        return False
    axis = field.axes[i] + field.axes[j]
    return bool(abs((d * d * axis.conjugate()).real) > ALONG_AXIS * square * abs(axis))


@vectorised
def _may_be_steps(field: Field, i: int, first: int, last: int, fit: npt.NDArray[np.bool_]) -> None:
    """Mask of the saddles in a range that are similar to one, a lattice step away and not backwards.

    A vectorised pre-test of `_is_step` without the direction. Each line is tested in one direction, or in both where it
    is nearly horizontal, as the second step may turn a little.
    """
    x, y = field.points[i].real, field.points[i].imag
    u, v, merit = field.axes[i].real, field.axes[i].imag, field.merits[i]
    points, axes, merits = field.points[first:last], field.axes[first:last], field.merits[first:last]
    for n in range(last - first):
        dx, dy = points[n].real - x, points[n].imag - y
        square = dx * dx + dy * dy
        near = (square > MIN_STEP * MIN_STEP) & (square < MAX_STEP * MAX_STEP) & (dy >= -LEVEL_SLOPE * abs(dx))
        like = (merits[n] < SAME_STRENGTH * merit) & (merit < SAME_STRENGTH * merits[n])
        fit[n] = near & like & (axes[n].real * u + axes[n].imag * v > SAME_AXIS)


@compiled
def _is_free(field: Field, i: int, j: int) -> bool:
    """Whether no similar saddle lies midway between two."""
    a, b = field.points[i], field.points[j]
    return nearest(field, (a + b) / 2, MIDDLE_RADIUS * abs(a - b), i, SAME_AXIS, SAME_STRENGTH) < 0


@compiled
def _double_capacity(triples: Indices) -> Indices:
    """Copy of the triples with the capacity doubled."""
    out = np.empty((2 * len(triples), 3), np.int64)
    for n in range(len(triples)):
        for m in range(3):
            out[n, m] = triples[n, m]
    return out


@compiled
def _triples(field: Field) -> Indices:
    """Triples (n, 3) of similar saddles, equally spaced on a line, in one or both directions."""
    out = np.empty((1024, 3), np.int64)
    count = 0
    fit = np.empty(len(field.points), np.bool_)
    for i in range(len(field.points)):
        place = field.points[i]
        top, bottom, first, last = bins_within(field, place, MAX_STEP)
        highest = int((place.imag - LEVEL_SLOPE * MAX_STEP - field.top) / field.side)
        for row in range(max(top, highest), bottom + 1):
            start, end = field.starts[row * field.columns + first], field.starts[row * field.columns + last + 1]
            _may_be_steps(field, i, start, end, fit)
            for j in range(start, end):
                if not fit[j - start] or not _is_step(field, i, j):
                    continue
                step = field.points[j] - place
                k = nearest(field, field.points[j] + step, COLLINEAR * abs(step), j, SAME_AXIS, SAME_STRENGTH)
                if k >= 0 and _is_step(field, j, k) and (_is_free(field, i, j) or _is_free(field, j, k)):
                    if count == len(out):
                        out = _double_capacity(out)
                    out[count, 0], out[count, 1], out[count, 2] = i, j, k
                    count += 1
    return out[:count]


def _strongest(field: Field, triples: Indices) -> Indices:
    """The strongest triples, at most MOST_TRIPLES."""
    if len(triples) <= MAX_TRIPLES:
        return triples
    strengths = field.merits[triples].min(axis=1)
    return triples[np.argpartition(-strengths, MAX_TRIPLES)[:MAX_TRIPLES]]


@compiled
def _sides(field: Field, triples: Indices) -> Indices:
    """Hypotheses that triples start at s = 0 or 1 of the side t = 0, with the chart on one side of it or the other.

    Returns the hits (n, 12) in the order of RIM, -1 for none, of the hypotheses with enough of the five nearest other
    x-corners, one of them off the side, and without both inner neighbours, which only a lattice of saddles has.
    """
    out = np.empty((4 * len(triples), 12), np.int64)
    count = 0
    for n in range(len(triples)):
        i, j, k = triples[n, 0], triples[n, 1], triples[n, 2]
        u = (field.points[k] - field.points[i]) / 2
        reach, near = COLLINEAR * abs(u), SQUARE * abs(u)
        least = MIN_NEAR if _is_free(field, i, j) and _is_free(field, j, k) else MIN_NEAR_CROWDED
        for which in range(4):
            first, v = which % 2, u * (1j if which < 2 else -1j)
            origin = field.points[i] - first * u
            if (
                nearest(field, origin + u + v, reach, j, SAME_AXIS, SAME_STRENGTH) >= 0
                and nearest(field, origin + 2 * u + v, reach, j, SAME_AXIS, SAME_STRENGTH) >= 0
            ):
                continue
            hits = out[count]
            for m in range(12):
                hits[m] = -1
            found = 0
            for t in range(1, 3):
                for s in range(0, 4, 3):
                    place = 4 + 2 * (t - 1) + s // 3  # of (s, t) in RIM
                    hits[place] = nearest(field, origin + s * u + t * v, near, j, SAME_AXIS, SAME_STRENGTH)
                    found += hits[place] >= 0
            if found == 0:
                continue
            hits[3 - 3 * first] = nearest(field, origin + (3 - 3 * first) * u, near, j, SAME_AXIS, SAME_STRENGTH)
            found += hits[3 - 3 * first] >= 0
            hits[first], hits[first + 1], hits[first + 2] = i, j, k
            count += found >= least
    return out[:count]


def _normalised(field: Field, hits: Indices) -> tuple[Complex, Complex, Array]:
    """Hits (n, 12) normalised by their means and spreads, 0 for none; the means and the spreads, (n, 1)."""
    present = hits >= 0
    z = np.where(present, field.points[hits], 0)
    count = present.sum(axis=1, keepdims=True)
    mean = z.sum(axis=1, keepdims=True) / count
    z = np.where(present, z - mean, 0)
    spread = np.sqrt((np.abs(z) ** 2).sum(axis=1, keepdims=True) / count)
    return z / spread, mean, spread


def _affine(field: Field, hits: Indices) -> Array:
    """Affine maps (n, 3, 3) from lattice to pixels, fitted to hits."""
    z, mean, spread = _normalised(field, hits)
    design = np.column_stack([RIM, np.ones(len(RIM))])
    present = (hits >= 0).astype(np.float64)
    normal = np.einsum("nr,ra,rb->nab", present, design, design)
    c = np.linalg.solve(normal + 0j, (z @ design)[..., None])[..., 0] * spread
    c[:, 2] += mean[:, 0]
    bottom = np.broadcast_to([0.0, 0.0, 1.0], c.shape)
    return np.stack([c.real, c.imag, bottom], axis=1)


def _projective(field: Field, hits: Indices) -> Array:
    """Homographies (n, 3, 3) from lattice to pixels, fitted to hits linearly in centred coordinates."""
    z, mean, spread = _normalised(field, hits)
    p = np.column_stack([RIM - 1.5, np.ones(len(RIM))])
    present = (hits >= 0).astype(np.float64)
    zero = np.zeros_like(p)
    rows = []
    for value, left in ((z.real, (p, zero)), (z.imag, (zero, p))):
        fixed = np.broadcast_to(np.hstack(left), (len(z), len(RIM), 6))
        rows.append(np.concatenate([fixed, -value[..., None] * p[:, :2]], axis=2) * present[..., None])
    design = np.concatenate(rows, axis=1)
    right = np.concatenate([z.real * present, z.imag * present], axis=1)[..., None]
    transposed = design.transpose(0, 2, 1)
    h = np.linalg.solve(transposed @ design + 1e-9 * np.eye(8), transposed @ right)[..., 0]
    local = np.concatenate([h, np.ones((len(h), 1))], axis=1).reshape(-1, 3, 3)
    back = np.zeros_like(local)
    back[:, 0, 0] = back[:, 1, 1] = spread[:, 0]
    back[:, 0, 2], back[:, 1, 2], back[:, 2, 2] = mean[:, 0].real, mean[:, 0].imag, 1
    maps: Array = back @ local @ np.array([[1, 0, -1.5], [0, 1, -1.5], [0, 0, 1]])
    return maps


def _mapped(maps: Array, lattice: Array) -> Complex:
    """Lattice points mapped to pixels, (n, m)."""
    q = maps @ np.column_stack([lattice, np.ones(len(lattice))]).T
    with np.errstate(divide="ignore", invalid="ignore"):
        out: Complex = (q[:, 0] + 1j * q[:, 1]).astype(np.complex128) / q[:, 2]
    return out


def _gather(field: Field, hits: Indices, maps: Array, reach: float) -> Indices:
    """Hits nearest to mapped lattices within `reach` steps, for those with enough hits and an empty interior."""
    predicted, inner = _mapped(maps, RIM), _mapped(maps, INSIDE)
    step = np.abs(predicted[:, 3] - predicted[:, 0]) / 3
    like = np.take_along_axis(hits, np.argmax(hits >= 0, axis=1)[:, None], 1)[:, 0]
    good = (
        (step > MIN_STEP / 2)
        & (step < 2 * MAX_STEP)
        & np.isfinite(predicted).all(axis=1)
        & np.isfinite(inner).all(axis=1)
    )
    predicted, inner, step, like = predicted[good], inner[good], step[good], like[good]
    lattice = (all_nearest(field, inner, PROJECTIVE * step, like, SAME_AXIS, SAME_STRENGTH) >= 0).sum(
        axis=1
    ) >= MOST_INSIDE
    predicted, step, like = predicted[~lattice], step[~lattice], like[~lattice]
    found = all_nearest(field, predicted, reach * step, like, SAME_AXIS, SAME_STRENGTH)
    enough: Indices = found[(found >= 0).sum(axis=1) >= MIN_HITS]
    return enough


def _distinct(field: Field, hits: Indices) -> Indices:
    """Remove duplicates, and keep at most MOST, those with the most hits and the strongest first."""
    _, first = np.unique(np.sort(hits, axis=1), axis=0, return_index=True)
    hits = hits[first]
    count = (hits >= 0).sum(axis=1)
    strengths = np.where(hits >= 0, np.log2(field.merits)[hits], 0).sum(axis=1) / np.maximum(count, 1)
    return hits[np.argsort(-count - HITS_PER_OCTAVE * strengths, kind="stable")[:MAX_LAYOUTS]]


def find_layouts(saddles: Saddles) -> Layouts:
    """Find the sets of saddles in the layout of a chart's x-corners, those with the most hits first.

    Parameters
    ----------
    saddles : Saddles
        Saddles of one level of the pyramid, where the lattice step is MIN_STEP to MAX_STEP pixels.
    """
    none = Layouts(np.zeros((0, 3, 3)), np.zeros((0, len(RIM)), dtype=np.bool_))
    if len(saddles.points) < MIN_HITS:
        return none
    field, _ = field_of(saddles.points, saddles.axes, saddles.strengths, BIN_SIDE)
    hits = _sides(field, _strongest(field, _triples(field)))
    if not len(hits):
        return none
    hits = _distinct(field, _gather(field, hits, _affine(field, hits), AFFINE))
    hits = _distinct(field, _gather(field, hits, _projective(field, hits), PROJECTIVE))
    return Layouts(_projective(field, hits) @ H_LATTICE_CELLS, hits >= 0)
