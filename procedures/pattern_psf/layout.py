"""Sets of saddles that lie like the chart's twelve x-corners, whatever its place, size, roll and tilt.

The x-corners are the rim of a 4 x 4 lattice, all with the same axis, and that axis is one of the lattice's. Three
equally spaced collinear saddles propose a side of it; what lies where the other nine should be decides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from procedures.pattern_psf.marks import Saddles

MIN_STEP, MAX_STEP = 8.0, 26.0
"""Lattice steps looked for at one level of the pyramid, in its pixels (three blocks of the chart)."""
SAME_AXIS = np.cos(2 * np.deg2rad(25))
"""Two x-corners of one chart differ by less than this angle (tilt, noise)."""
ALONG_AXIS = np.cos(2 * np.deg2rad(22))
"""The lattice is along the axes or across them, up to the shear of a tilt and the axes' own error."""
SAME_STRENGTH = 3.0
"""Greatest ratio of strengths within one side: light gradient, noise, focus."""
MIN_HITS = 7
"""A chart with fewer x-corners in sight is not found."""

RIM = np.array([(s, t) for t in range(4) for s in range(4) if s in (0, 3) or t in (0, 3)], dtype=np.float64)
"""The lattice coordinates (s, t) of the twelve x-corners, (12, 2)."""
Complex = npt.NDArray[np.complex128]
Indices = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Layout:
    """One set of saddles that lie like a chart's x-corners.

    Attributes
    ----------
    points : (12, 2) float64
        (x, y) of the saddles in the order of RIM, NaN where there is none.
    hits : int
        How many there are.
    """

    points: npt.NDArray[np.float64]
    hits: int


def _alike(saddles: Saddles, i: Indices, j: Indices) -> npt.NDArray[np.bool_]:
    """Whether two saddles could be x-corners of one chart."""
    ratio = np.log(saddles.strengths[i] / saddles.strengths[j])
    cosine = (saddles.axes[i] * saddles.axes[j].conj()).real
    return (cosine > SAME_AXIS) & (np.abs(ratio) < np.log(SAME_STRENGTH))


def _nearest_alike(tree: cKDTree, saddles: Saddles, targets: Complex, reach: npt.NDArray[np.float64], like: Indices) -> Indices:
    """Index of the nearest saddle within `reach` of each target that is like a given one; -1 where there is none."""
    flat = targets.ravel()
    distance, index = tree.query(np.column_stack([flat.real, flat.imag]), k=3)
    shape = (*targets.shape, 3)
    distance, index = distance.reshape(shape), index.reshape(shape)
    known = np.minimum(index, len(saddles.points) - 1)
    fits = (distance <= reach[..., None]) & _alike(saddles, known, np.broadcast_to(like[..., None], shape))
    first = np.argmax(fits, axis=-1)[..., None]
    return np.where(fits.any(axis=-1), np.take_along_axis(known, first, -1)[..., 0], -1)


def _pairs(tree: cKDTree, saddles: Saddles) -> tuple[Indices, Indices]:
    """Pairs of like saddles one lattice step apart, each in both directions."""
    pairs = tree.query_pairs(MAX_STEP, output_type="ndarray")
    i, j = pairs[:, 0], pairs[:, 1]
    d = saddles.points[j] - saddles.points[i]
    length = np.abs(d)
    axis = saddles.axes[i] + saddles.axes[j]
    along = np.abs((d * d * axis.conj()).real) > ALONG_AXIS * length**2 * np.abs(axis)
    keep = (length > MIN_STEP) & along & _alike(saddles, i, j)
    i, j = i[keep], j[keep]
    return np.r_[i, j], np.r_[j, i]


def _triples(tree: cKDTree, saddles: Saddles) -> tuple[Indices, Indices, Indices]:
    """Triples of like saddles, equally spaced on a line: i, its middle j, k."""
    i, j = _pairs(tree, saddles)
    step = saddles.points[j] - saddles.points[i]
    k = _nearest_alike(tree, saddles, saddles.points[j] + step, 0.15 * np.abs(step) + 0.5, j)
    keep = (k >= 0) & (i < k)
    return i[keep], j[keep], k[keep]


def _affine_prediction(hits: Indices, points: Complex, weights: npt.NDArray[np.float64]) -> Complex:
    """Where each hypothesis' affine lattice, fitted to its hits, has its twelve points, (n, 12)."""
    design = np.column_stack([np.ones(len(RIM)), RIM])
    normal = np.einsum("nr,ra,rb->nab", weights, design, design)
    right = np.einsum("nr,ra,nr->na", weights, design, np.where(hits >= 0, points[hits], 0))
    coefficients = np.linalg.solve(normal, right[..., None])[..., 0]
    return coefficients @ design.T


def find_layouts(saddles: Saddles, *, most: int = 60) -> list[Layout]:
    """The sets of saddles that lie like a chart's x-corners, those with the most hits first.

    Parameters
    ----------
    saddles : Saddles
        Of one level of the pyramid, where the lattice step is MIN_STEP to MAX_STEP pixels.
    most : int
        The longest list given.
    """
    if len(saddles.points) < MIN_HITS:
        return []
    tree = cKDTree(np.column_stack([saddles.points.real, saddles.points.imag]))
    i, j, k = _triples(tree, saddles)
    hypotheses = [_side(tree, saddles, (i, j, k), side, first) for side in (1, -1) for first in (0, 1)]
    hits = np.concatenate([h for h, _ in hypotheses])
    like = np.concatenate([m for _, m in hypotheses])
    for reach in (0.25, 0.25):
        hits, like = _gather(tree, saddles, hits, like, reach)
    return _best(saddles, hits, most)


def _side(
    tree: cKDTree, saddles: Saddles, triple: tuple[Indices, Indices, Indices], side: int, first: int
) -> tuple[Indices, Indices]:
    """Hypotheses that triples start at s = `first` of a side, the chart lying on one `side` of it.

    Gives the hits (n, 12) in the order of RIM, -1 where none, and the middle saddle of each triple, for those
    hypotheses that find two of the three nearest other x-corners.
    """
    i, j, k = triple
    u = (saddles.points[k] - saddles.points[i]) / 2
    v = 1j * side * u
    origin = saddles.points[i] - first * u
    fourth = 3 - 3 * first
    near = np.array([(fourth, 0), (0, 1), (3, 1)])
    targets = origin[:, None] + u[:, None] * near[:, 0] + v[:, None] * near[:, 1]
    reach = np.broadcast_to(0.3 * np.abs(u)[:, None], targets.shape)
    found = _nearest_alike(tree, saddles, targets, reach, np.broadcast_to(j[:, None], targets.shape))
    keep = (found >= 0).sum(axis=1) >= 2
    hits = np.full((len(i), len(RIM)), -1)
    for where, which in zip([(first, 0), (first + 1, 0), (first + 2, 0)], triple, strict=True):
        hits[:, _rim_index(where)] = which
    for where, which in zip(near, found.T, strict=True):
        hits[:, _rim_index((int(where[0]), int(where[1])))] = which
    return hits[keep], j[keep]


def _rim_index(where: tuple[int, int]) -> int:
    return int(np.flatnonzero((where == RIM).all(axis=1))[0])


def _gather(tree: cKDTree, saddles: Saddles, hits: Indices, like: Indices, reach: float) -> tuple[Indices, Indices]:
    """The hits nearest to the affine lattice through the present ones, `reach` in lattice steps."""
    if not len(hits):
        return hits, like
    predicted = _affine_prediction(hits, saddles.points, (hits >= 0).astype(np.float64))
    step = np.abs(predicted[:, 3] - predicted[:, 0]) / 3
    radii = np.broadcast_to(reach * step[:, None], hits.shape)
    found = _nearest_alike(tree, saddles, predicted, radii, np.broadcast_to(like[:, None], hits.shape))
    keep = (found >= 0).sum(axis=1) >= MIN_HITS - 1
    return found[keep], like[keep]


def _best(saddles: Saddles, hits: Indices, most: int) -> list[Layout]:
    """Layouts of the hypotheses with the most hits, each set of saddles once."""
    counts = (hits >= 0).sum(axis=1)
    layouts: list[Layout] = []
    seen: set[frozenset[int]] = set()
    for n in np.argsort(-counts, kind="stable"):
        if counts[n] < MIN_HITS or len(layouts) == most:
            break
        key = frozenset(hits[n][hits[n] >= 0].tolist())
        if key in seen:
            continue
        seen.add(key)
        points = np.where(hits[n] >= 0, saddles.points[hits[n]], complex(np.nan, np.nan))
        layouts.append(Layout(np.column_stack([points.real, points.imag]), int(counts[n])))
    return layouts
