"""Sets of saddles that lie like the chart's twelve x-corners, whatever its place, size, roll and tilt.

The x-corners are the rim of a 4 x 4 lattice, all with the same axis, and that axis is one of the lattice's. Three
equally spaced collinear saddles propose a side of it; what lies where the other nine should be decides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from procedures.pattern import BLOCK
from procedures.pattern_psf.marks import SAME_AXIS, Saddles

MIN_STEP, MAX_STEP = 16.5, 38.0
"""Lattice steps looked for at one level of the pyramid, in its pixels (three blocks of the chart)."""
ALONG_AXIS = np.cos(2 * np.deg2rad(11))
"""The lattice is along the axes or across them, up to the shear of a tilt and the axes' own error."""
SAME_STRENGTH = 2.5
"""Greatest ratio of strengths within one side: light gradient, noise, focus."""
COLLINEAR = 0.15
"""Greatest distance of a third x-corner from where two put it, in steps: perspective, distortion."""
BETWEEN = 0.2
"""No like saddle lies this close to the middle of two neighbouring x-corners, in steps: it would in a finer lattice."""
MOST_TRIPLES = 20_000
SQUARE = 0.3
"""The same from where a side puts a neighbouring one, supposing a square: tilt."""
AFFINE = 0.25
PROJECTIVE = 0.15
"""The same for affine and projective lattices."""
MIN_HITS = 7
"""A chart with fewer x-corners in sight is not found."""
HITS_PER_OCTAVE = 4.0
"""What twice the strength is worth, in hits, where there are too many layouts: a chart has the strongest saddles."""
MOST = 4000
"""Layouts given for one picture; textures and lattices have many."""

RIM = np.array([(s, t) for t in range(4) for s in range(4) if s in (0, 3) or t in (0, 3)], dtype=np.float64)
"""The lattice coordinates (s, t) of the twelve x-corners, (12, 2)."""
INSIDE = np.array([(1, 1), (2, 1), (1, 2), (2, 2)], dtype=np.float64)
MOST_INSIDE = 3
"""Like saddles at the lattice points inside, where the chart has noise, that tell a lattice from a chart."""
RIM_CELLS = RIM * 3 * BLOCK - BLOCK / 2
"""The same places in cells."""
H_LATTICE_CELLS = np.array([[1, 0, BLOCK / 2], [0, 1, BLOCK / 2], [0, 0, 3 * BLOCK]]) / (3 * BLOCK)
Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]
Indices = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Layouts:
    """Sets of saddles that lie like a chart's x-corners.

    A square's eight symmetries leave the x-corners in place: which of them applies is not known here.

    Attributes
    ----------
    maps : (n, 3, 3) float64
        Homographies from cells to pixels.
    hits : (n, 12) bool
        Which x-corners there are, in the order of RIM.
    """

    maps: Array
    hits: npt.NDArray[np.bool_]


@dataclass(frozen=True)
class _Field:
    """Saddles with an index of their places."""

    saddles: Saddles
    tree: cKDTree

    def alike(self, i: Indices, j: Indices) -> npt.NDArray[np.bool_]:
        """Whether two saddles could be x-corners of one chart."""
        a, b = self.saddles.strengths[i], self.saddles.strengths[j]
        cosine = (self.saddles.axes[i] * self.saddles.axes[j].conj()).real
        alike: npt.NDArray[np.bool_] = (cosine > SAME_AXIS) & (a < SAME_STRENGTH * b) & (b < SAME_STRENGTH * a)
        return alike

    def nearest(self, targets: Complex, reach: Array, like: Indices) -> Indices:
        """For (n, m) targets the nearest saddle within (n,) reach that is like the n-th given one; -1 for none."""
        flat = np.column_stack([targets.real.ravel(), targets.imag.ravel()])
        distance, index = self.tree.query(flat, k=3, distance_upper_bound=reach.max(initial=0.0))
        shape = (*targets.shape, 3)
        known = np.minimum(index, len(self.saddles.points) - 1).reshape(shape)
        fits = distance.reshape(shape) <= reach[:, None, None]
        fits &= self.alike(known, np.broadcast_to(like[:, None, None], shape))
        first = np.argmax(fits, axis=-1)[..., None]
        return np.where(fits.any(axis=-1), np.take_along_axis(known, first, -1)[..., 0], -1)


def _pairs(field: _Field) -> tuple[Indices, Indices]:
    """Pairs of like saddles one lattice step apart, each in both directions."""
    pairs = field.tree.query_pairs(MAX_STEP, output_type="ndarray")
    points, axes = field.saddles.points, field.saddles.axes
    d = points[pairs[:, 1]] - points[pairs[:, 0]]
    far = np.abs(d) > MIN_STEP
    pairs, d = pairs[far], d[far]
    axis = axes[pairs[:, 0]] + axes[pairs[:, 1]]
    along = np.abs((d * d * axis.conj()).real) > ALONG_AXIS * np.abs(d) ** 2 * np.abs(axis)
    i, j = pairs[along].T
    keep = field.alike(i, j)
    i, j = i[keep], j[keep]
    middle, length = (points[i] + points[j]) / 2, np.abs(points[i] - points[j])
    free = field.nearest(middle[:, None], BETWEEN * length, i)[:, 0] < 0
    return np.r_[i[free], j[free]], np.r_[j[free], i[free]]


def _triples(field: _Field) -> Indices:
    """Triples of like saddles, equally spaced on a line, (n, 3), at most MOST_TRIPLES."""
    i, j = _pairs(field)
    points, count = field.saddles.points, len(field.saddles.points)
    step = points[j] - points[i]
    k = field.nearest((points[j] + step)[:, None], COLLINEAR * np.abs(step), j)[:, 0]
    keep = (k >= 0) & (i < k) & np.isin(j * count + k, i * count + j)
    triples = np.column_stack([i, j, k])[keep]
    if len(triples) <= MOST_TRIPLES:
        return triples
    strengths = field.saddles.strengths[triples].min(axis=1)
    return triples[np.argpartition(-strengths, MOST_TRIPLES)[:MOST_TRIPLES]]


def _rim_index(s: int, t: int) -> int:
    return int(np.flatnonzero(np.all([s, t] == RIM, axis=1))[0])


def _sides(field: _Field, triples: Indices, side: int, first: int) -> Indices:
    """Hypotheses that triples start at s = `first` of the side t = 0, the chart lying to one `side` of it.

    Gives the hits (n, 12) in the order of RIM, -1 where none, for those that find two of the five nearest others,
    one of them off the side, and not both of the inner neighbours, which only a lattice of saddles has.
    """
    points = field.saddles.points
    u = (points[triples[:, 2]] - points[triples[:, 0]]) / 2
    v = 1j * side * u
    origin = points[triples[:, 0]] - first * u
    inside = np.column_stack([origin + s * u + v for s in (1, 2)])
    open_ = (field.nearest(inside, COLLINEAR * np.abs(u), triples[:, 1]) < 0).any(axis=1)
    triples, origin, u, v = triples[open_], origin[open_], u[open_], v[open_]
    others = [(3 - 3 * first, 0), (0, 1), (3, 1), (0, 2), (3, 2)]
    targets = np.column_stack([origin + s * u + t * v for s, t in others])
    found = field.nearest(targets, SQUARE * np.abs(u), triples[:, 1])
    hits = np.full((len(triples), len(RIM)), -1)
    hits[:, [_rim_index(first + n, 0) for n in range(3)]] = triples
    hits[:, [_rim_index(s, t) for s, t in others]] = found
    off_side = (found[:, 1:] >= 0).any(axis=1)
    enough: Indices = hits[off_side & ((found >= 0).sum(axis=1) >= 2)]
    return enough


def _normalised(field: _Field, hits: Indices) -> tuple[Complex, Complex, Array]:
    """Hits about their mean in units of their spread, (n, 12), 0 where none; the means and the spreads, (n, 1)."""
    there = hits >= 0
    z = np.where(there, field.saddles.points[hits], 0)
    count = there.sum(axis=1, keepdims=True)
    mean = z.sum(axis=1, keepdims=True) / count
    z = np.where(there, z - mean, 0)
    spread = np.sqrt((np.abs(z) ** 2).sum(axis=1, keepdims=True) / count)
    return z / spread, mean, spread


def _affine(field: _Field, hits: Indices) -> Array:
    """Affine maps fitted to hits, from lattice to pixels, (n, 3, 3)."""
    z, mean, spread = _normalised(field, hits)
    design = np.column_stack([RIM, np.ones(len(RIM))])
    there = (hits >= 0).astype(np.float64)
    normal = np.einsum("nr,ra,rb->nab", there, design, design)
    c = np.linalg.solve(normal + 0j, (z @ design)[..., None])[..., 0] * spread
    c[:, 2] += mean[:, 0]
    bottom = np.broadcast_to([0.0, 0.0, 1.0], c.shape)
    return np.stack([c.real, c.imag, bottom], axis=1)


def _projective(field: _Field, hits: Indices) -> Array:
    """Homographies fitted to hits, from lattice to pixels, (n, 3, 3); the fit is linear, from the middle out."""
    z, mean, spread = _normalised(field, hits)
    p = np.column_stack([RIM - 1.5, np.ones(len(RIM))])
    there = (hits >= 0).astype(np.float64)
    zero = np.zeros_like(p)
    rows = []
    for value, left in ((z.real, (p, zero)), (z.imag, (zero, p))):
        fixed = np.broadcast_to(np.hstack(left), (len(z), len(RIM), 6))
        rows.append(np.concatenate([fixed, -value[..., None] * p[:, :2]], axis=2) * there[..., None])
    design = np.concatenate(rows, axis=1)
    right = np.concatenate([z.real * there, z.imag * there], axis=1)[..., None]
    transposed = design.transpose(0, 2, 1)
    h = np.linalg.solve(transposed @ design + 1e-9 * np.eye(8), transposed @ right)[..., 0]
    local = np.concatenate([h, np.ones((len(h), 1))], axis=1).reshape(-1, 3, 3)
    back = np.zeros_like(local)
    back[:, 0, 0] = back[:, 1, 1] = spread[:, 0]
    back[:, 0, 2], back[:, 1, 2], back[:, 2, 2] = mean[:, 0].real, mean[:, 0].imag, 1
    maps: Array = back @ local @ np.array([[1, 0, -1.5], [0, 1, -1.5], [0, 0, 1]])
    return maps


def _mapped(maps: Array, lattice: Array) -> Complex:
    """Where maps put lattice points, (n, m)."""
    q = maps @ np.column_stack([lattice, np.ones(len(lattice))]).T
    with np.errstate(divide="ignore", invalid="ignore"):
        out: Complex = (q[:, 0] + 1j * q[:, 1]).astype(np.complex128) / q[:, 2]
    return out


def _gather(field: _Field, hits: Indices, maps: Array, reach: float) -> Indices:
    """The hits nearest to mapped lattices, `reach` in steps, of those that keep enough and are empty inside."""
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
    lattice = (field.nearest(inner, PROJECTIVE * step, like) >= 0).sum(axis=1) >= MOST_INSIDE
    predicted, step, like = predicted[~lattice], step[~lattice], like[~lattice]
    found = field.nearest(predicted, reach * step, like)
    enough: Indices = found[(found >= 0).sum(axis=1) >= MIN_HITS]
    return enough


def _distinct(field: _Field, hits: Indices) -> Indices:
    """One of each set of saddles, those with the most hits and the strongest first, at most MOST."""
    _, first = np.unique(np.sort(hits, axis=1), axis=0, return_index=True)
    hits = hits[first]
    count = (hits >= 0).sum(axis=1)
    strengths = np.where(hits >= 0, np.log2(field.saddles.strengths)[hits], 0).sum(axis=1) / np.maximum(count, 1)
    return hits[np.argsort(-count - HITS_PER_OCTAVE * strengths, kind="stable")[:MOST]]


def find_layouts(saddles: Saddles) -> Layouts:
    """The sets of saddles that lie like a chart's x-corners, those with the most hits first.

    Parameters
    ----------
    saddles : Saddles
        Of one level of the pyramid, where the lattice step is MIN_STEP to MAX_STEP pixels.
    """
    if len(saddles.points) < MIN_HITS:
        return Layouts(np.zeros((0, 3, 3)), np.zeros((0, len(RIM)), dtype=np.bool_))
    field = _Field(saddles, cKDTree(np.column_stack([saddles.points.real, saddles.points.imag])))
    triples = _triples(field)
    hits = np.concatenate([_sides(field, triples, side, first) for side in (1, -1) for first in (0, 1)])
    hits = _distinct(field, _gather(field, hits, _affine(field, hits), AFFINE))
    hits = _distinct(field, _gather(field, hits, _projective(field, hits), PROJECTIVE))
    return Layouts(_projective(field, hits) @ H_LATTICE_CELLS, hits >= 0)
