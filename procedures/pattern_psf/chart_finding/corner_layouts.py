"""Sets of saddles in the layout of the chart's twelve x-corners, for any position, size, roll and tilt.

The x-corners are the border of a 4 x 4 lattice. They have one common axis, parallel to an axis of the lattice. Three
equally spaced collinear saddles propose a side; saddles at the other nine points confirm it.
"""

from dataclasses import dataclass

import numpy as np

from procedures.numerics import loops
from procedures.numerics.arrays import Array, BinnedSaddles, Complex, Indices, LayoutRules, Mask, field_of
from procedures.pattern import BLOCK
from procedures.pattern_psf.chart_finding.marks import SAME_AXIS, Saddles

RULES = LayoutRules(
    min_step=16.5, max_step=38.0,  # at one level of the pyramid; a step is three blocks of the chart
    along_axis=float(np.cos(2 * np.deg2rad(11))),  # shear by tilt and errors of the axes
    same_axis=SAME_AXIS,
    same_merit=2.5,  # ratio of strengths within one side: light gradient, noise, focus
    collinear=0.15,  # perspective, distortion
    middle_radius=0.2,
    square=0.3,  # tilt
    level_slope=0.3,  # more than `collinear` can turn a step
    min_near=2, min_near_crowded=4,
)  # fmt: skip
MAX_TRIPLES = 20_000
BIN_SIDE = 12.0  # side of the bins of the spatial index, in pixels
AFFINE = 0.25
PROJECTIVE = 0.15  # greatest distances from the predictions by affine and projective lattices, in steps
MIN_HITS = 7  # least number of visible x-corners of a chart
HITS_PER_OCTAVE = 4.0
"""Hits equivalent to twice the strength when layouts are ranked: a chart has the strongest saddles."""
MAX_LAYOUTS = 4000  # greatest number of layouts of one picture; textures and lattices have many

RIM = np.array([(s, t) for t in range(4) for s in range(4) if s in (0, 3) or t in (0, 3)], dtype=np.float64)
"""Lattice coordinates (s, t) of the twelve x-corners, (12, 2)."""
INSIDE = np.array([(1, 1), (2, 1), (1, 2), (2, 2)], dtype=np.float64)
MOST_INSIDE = 3  # similar saddles at the inner lattice points, where a chart has noise, from which on it is a lattice
RIM_CELLS = RIM * 3 * BLOCK - BLOCK / 2  # the x-corners in cells, (12, 2)
H_LATTICE_CELLS = np.array([[1, 0, BLOCK / 2], [0, 1, BLOCK / 2], [0, 0, 3 * BLOCK]]) / (3 * BLOCK)


@dataclass(frozen=True)
class Layouts:
    """Sets of saddles in the layout of a chart's x-corners.

    The orientation, one of the square's eight symmetries, is not determined here.

    maps : (n, 3, 3) homographies from cells to pixels; hits : (n, 12) bool mask of the x-corners that have a saddle, in
    the order of RIM.
    """

    maps: Array
    hits: Mask


def _normalised(field: BinnedSaddles, hits: Indices) -> tuple[Complex, Complex, Array]:
    """Hits (n, 12) normalised by their means and spreads, 0 for none; the means and the spreads, (n, 1)."""
    present = hits >= 0
    z = np.where(present, field.points[hits], 0)
    count = present.sum(axis=1, keepdims=True)
    mean = z.sum(axis=1, keepdims=True) / count
    z = np.where(present, z - mean, 0)
    spread = np.sqrt((np.abs(z) ** 2).sum(axis=1, keepdims=True) / count)
    return z / spread, mean, spread


def _projective(field: BinnedSaddles, hits: Indices) -> Array:
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


def _gather(field: BinnedSaddles, hits: Indices, maps: Array, reach: float) -> Indices:
    """Hits nearest to mapped lattices within `reach` steps, for those with enough hits and an empty interior."""
    predicted, inner = _mapped(maps, RIM), _mapped(maps, INSIDE)
    step = np.abs(predicted[:, 3] - predicted[:, 0]) / 3
    like = np.take_along_axis(hits, np.argmax(hits >= 0, axis=1)[:, None], 1)[:, 0]
    good = (
        (step > RULES.min_step / 2)
        & (step < 2 * RULES.max_step)
        & np.isfinite(predicted).all(axis=1)
        & np.isfinite(inner).all(axis=1)
    )
    predicted, inner, step, like = predicted[good], inner[good], step[good], like[good]
    lattice = (loops.all_nearest(field, inner, PROJECTIVE * step, like, RULES) >= 0).sum(axis=1) >= MOST_INSIDE
    predicted, step, like = predicted[~lattice], step[~lattice], like[~lattice]
    neighbours = loops.all_nearest(field, predicted, reach * step, like, RULES)
    enough: Indices = neighbours[(neighbours >= 0).sum(axis=1) >= MIN_HITS]
    return enough


def _distinct(field: BinnedSaddles, hits: Indices) -> Indices:
    """Remove duplicates, and keep at most MAX_LAYOUTS, those with the most hits and the strongest first."""
    _, first = np.unique(np.sort(hits, axis=1), axis=0, return_index=True)
    hits = hits[first]
    count = (hits >= 0).sum(axis=1)
    strengths = np.where(hits >= 0, np.log2(field.merits)[hits], 0).sum(axis=1) / np.maximum(count, 1)
    return hits[np.argsort(-count - HITS_PER_OCTAVE * strengths, kind="stable")[:MAX_LAYOUTS]]


def find_layouts(saddles: Saddles) -> Layouts:
    """The sets of a level's saddles in the layout of a chart's x-corners, those with the most hits first."""
    none = Layouts(np.zeros((0, 3, 3)), np.zeros((0, len(RIM)), dtype=np.bool_))
    if len(saddles.points) < MIN_HITS:
        return none
    field, _ = field_of(saddles.points, saddles.axes, saddles.strengths, BIN_SIDE)
    triples = loops.collinear_triples(field, RULES)
    if len(triples) > MAX_TRIPLES:
        triples = triples[np.argpartition(-field.merits[triples].min(axis=1), MAX_TRIPLES)[:MAX_TRIPLES]]
    hits = loops.square_sides(field, triples, RULES)
    if not len(hits):
        return none
    # affine maps (n, 3, 3) from lattice to pixels, fitted to hits
    z, mean, spread = _normalised(field, hits)
    design = np.column_stack([RIM, np.ones(len(RIM))])
    present = (hits >= 0).astype(np.float64)
    normal = np.einsum("nr,ra,rb->nab", present, design, design)
    c = np.linalg.solve(normal + 0j, (z @ design)[..., None])[..., 0] * spread
    c[:, 2] += mean[:, 0]
    bottom = np.broadcast_to([0.0, 0.0, 1.0], c.shape)
    affine = np.stack([c.real, c.imag, bottom], axis=1)
    hits = _distinct(field, _gather(field, hits, affine, AFFINE))
    hits = _distinct(field, _gather(field, hits, _projective(field, hits), PROJECTIVE))
    return Layouts(_projective(field, hits) @ H_LATTICE_CELLS, hits >= 0)
