"""The chart's own slanted edges: MTF50 across them beside that of the PSF, from one frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from procedures.cross_check.surroundings import without_surroundings
from procedures.numbers import EDGE_MTF50
from procedures.numerics.ordered import quantile
from procedures.outcome import Quantity
from procedures.pattern import BLOCK, CELLS, EDGE_END, EDGES
from procedures.pattern_psf.estimate import PatternPsf
from procedures.quality import quantity_along
from procedures.raw import Plane

if TYPE_CHECKING:
    from procedures.slanted_edge.estimate import EdgeMtf
    from procedures.slanted_edge.strip import EdgeLine, Strip

Array = npt.NDArray[np.float64]

CLEAR_PX = 2.5
"""Pixels that are left out beside everything else that is printed: the PSF reaches over its border."""
LEAST_CONTRAST = 0.4
"""Of the chart's: what is fainter is no printed edge, but what lies behind a chart without one."""
SHAPE = 0.06
"""Relative uncertainty of the tail beyond its noise: out there no true tail is quite 1 / r^3."""
MORE = 0.1
"""By what share the tail is enlarged to see what hangs on it."""
WIDEST_BLOCKS = 1.8
"""The plains' width, where they are widest."""
ASIDE_CELLS, ASIDE_PX = 3.0, 3.0
"""How far from where the chart puts it an edge may be found: what the map is off, out there beyond its marks."""


@dataclass(frozen=True, eq=False)
class EdgeCheck:
    """One printed edge: MTF50 across it, and of the PSF along its normal, all light counted in both.

    Attributes
    ----------
    edge : EdgeMtf
    by_edge, by_psf : Quantity
        In cycles per pixel of the plane.
    """

    edge: EdgeMtf
    by_edge: Quantity
    by_psf: Quantity

    @property
    def difference(self) -> float:
        """By the PSF less by the edge, over the latter."""
        return self.by_psf.value / self.by_edge.value - 1

    @property
    def sigmas(self) -> float:
        """The difference in its standard errors."""
        spread = math.hypot(self.by_psf.uncertainty, self.by_edge.uncertainty)
        return (self.by_psf.value - self.by_edge.value) / spread


def check_edges(plane: Plane, found: PatternPsf) -> tuple[EdgeCheck, ...]:
    """The printed edges that the photograph shows, each beside the PSF; none where the chart has none.

    Whether they were printed is seen in the photograph: at their place there must be the chart's own contrast, in
    their direction, with white on the chart's side.
    """
    found_edges = [edge for i in range(len(EDGES)) if (edge := _measured(plane, found, i)) is not None]
    pairs = [(edge, quantity_along(found.psf, edge.normal_deg, found.n)) for edge in found_edges]
    return tuple(EdgeCheck(edge, edge.numbers[EDGE_MTF50], by_psf) for edge, by_psf in pairs if by_psf is not None)


def _measured(plane: Plane, found: PatternPsf, i: int) -> EdgeMtf | None:
    """The MTF across one of the chart's edges, None where it is not to be seen or cannot be measured."""
    placed = _strip(plane, found, i)
    if placed is None or not _shows_edge(*placed, found):
        return None
    from procedures.slanted_edge.estimate import measure
    from procedures.slanted_edge.tail import Tail

    strip, line = placed
    first = measure(strip, line).value
    if first is None:
        return None
    density = found.psf.tail_density_px
    alone = without_surroundings(plane.samples, strip, first.course, density)
    # the tail's line spread function is 2 A / d^2, the edge's approach to its plains 2 A / d
    edge = measure(replace(strip, samples=alone, tail=Tail(2 * density)), line).value
    other = measure(replace(strip, samples=alone, tail=Tail(2 * density * (1 + MORE))), line).value
    if edge is None or EDGE_MTF50 not in edge.numbers or other is None or EDGE_MTF50 not in other.numbers:
        return None
    edge = _with_tail_uncertainty(edge, other, found)
    cells = found.registration.to_pattern(edge.course)
    across, along = cells[:, i], cells[:, 1 - i]
    start, end = EDGES[i]
    expected = start[i] + (end - start)[i] * along / CELLS
    aside = max(ASIDE_CELLS, ASIDE_PX / _cell_px(found))
    return edge if np.abs(across - expected).max() < aside else None


def _with_tail_uncertainty(edge: EdgeMtf, other: EdgeMtf, found: PatternPsf) -> EdgeMtf:
    """The edge's MTF50 with what the tail's uncertainty adds to its own; `other` had a tail larger by `MORE`."""
    own = edge.numbers[EDGE_MTF50]
    slope = (other.numbers[EDGE_MTF50].value - own.value) / MORE
    of_tail = slope * min(_tail_uncertainty(found), 1.0)
    whole = replace(own, uncertainty=math.hypot(own.uncertainty, of_tail))
    return replace(edge, numbers={**edge.numbers, EDGE_MTF50: whole})


def _tail_uncertainty(found: PatternPsf) -> float:
    """Relative uncertainty of the tail's energy, noise and shape together; infinite where there is none."""
    tail = found.psf.tail
    noise = float(tail.covariance[0, 0]) ** 0.5 / abs(float(tail.amplitudes[0])) if tail.amplitudes[0] else math.inf
    return math.hypot(noise, SHAPE)


def _cell_px(found: PatternPsf) -> float:
    """Side of a cell in pixels of the plane."""
    return 1 / math.sqrt(abs(np.linalg.det(found.registration.jacobian())))


def _strip(plane: Plane, found: PatternPsf, i: int) -> tuple[Strip, EdgeLine] | None:
    """Where the map puts an edge: its strip, all else that is printed masked, and the line; None outside the frame."""
    registration = found.registration
    cell_px = _cell_px(found)
    clear = CLEAR_PX / cell_px
    start, end = EDGES[i]
    inset = (end - start) / np.linalg.norm(end - start) * clear
    ends = registration.to_sensor(np.array([start + inset, end - inset]))
    limit = np.array(plane.samples.shape[::-1]) - 1
    if not (np.isfinite(ends).all() and (ends > CLEAR_PX).all() and (ends < limit - CLEAR_PX).all()):
        return None
    # most charts are printed without edges: what measures them is imported where there is room for one
    from procedures.slanted_edge.find import strip_along
    from procedures.slanted_edge.strip import LEAST_SIDE

    reach = WIDEST_BLOCKS * BLOCK * cell_px
    strip, line = strip_along(plane.samples, ends[0], ends[1], reach)
    if min(strip.samples.shape) < LEAST_SIDE:
        return None
    roi = strip.roi
    x, y = np.meshgrid(roi.x + np.arange(roi.width), roi.y + np.arange(roi.height))
    cells = registration.to_pattern(np.column_stack([x.ravel(), y.ravel()]).astype(np.float64))
    across, along = cells[:, i], cells[:, 1 - i]
    valid = (across > CELLS + BLOCK + clear) & (across < EDGE_END - clear) & (along > clear) & (along < CELLS - clear)
    shaped = valid.reshape(roi.height, roi.width)
    near = replace(line, near_px=max(ASIDE_PX, ASIDE_CELLS * cell_px))
    return replace(strip, valid=shaped.T if strip.turned else shaped, reach_px=reach), near


def _shows_edge(strip: Strip, line: EdgeLine, found: PatternPsf) -> bool:
    """Whether there are two levels as far apart as the chart's black and white."""
    from procedures.slanted_edge.strip import LEAST_SIDE

    d = np.arange(strip.samples.shape[1]) - line.middle - line.slope * strip.along[:, None]
    sides = [strip.samples[strip.usable & (d * sign > CLEAR_PX)] for sign in (-1, 1)]
    if min(map(len, sides)) < LEAST_SIDE**2 / 2:
        return False
    contrast = abs(quantile(sides[0], 0.5) - quantile(sides[1], 0.5))
    return contrast > LEAST_CONTRAST * found.diagnostics["contrast"]
