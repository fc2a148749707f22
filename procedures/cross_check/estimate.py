"""MTF50 across the chart's slanted edges compared with that of the PSF, from one frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from procedures.numbers import EDGE_MTF50
from procedures.numerics import transforms
from procedures.numerics.arrays import Array, Array32, quantile
from procedures.outcome import Quantity
from procedures.pattern import BLOCK, CELLS, EDGE_END, EDGES
from procedures.pattern_psf.estimate import PatternPsf
from procedures.quality import quantity_along
from procedures.raw import Plane
from procedures.slanted_edge.strip import Strip

if TYPE_CHECKING:
    from procedures.slanted_edge.estimate import EdgeMtf
    from procedures.slanted_edge.strip import EdgeLine, Strip

MARGIN_PX = 2.5  # margin in pixels excluded next to other printed areas, for the PSF's width
MIN_CONTRAST = 0.4
"""Least contrast of an edge over the chart's; a fainter step belongs to the background of a chart without edges."""
TAIL_SHAPE_UNCERTAINTY = 0.06  # relative uncertainty of the tail in addition to noise, since no tail is exactly 1 / r^3
TAIL_INCREASE = 0.1  # relative increase of the tail for the numerical derivative by it
WIDEST_BLOCKS = 1.8  # greatest width of the plains
MAX_OFFSET_CELLS, MAX_OFFSET_PX = 3.0, 3.0
"""Greatest distance of an edge from its expected position, for the map's extrapolation beyond its marks."""


@dataclass(frozen=True, eq=False)
class EdgeCheck:
    """Comparison at one printed edge: MTF50 across it, and MTF50 of the PSF along its normal, both including the tail.

    by_edge, by_psf : in cycles per pixel of the plane.
    """

    edge: EdgeMtf
    by_edge: Quantity
    by_psf: Quantity

    @property
    def difference(self) -> float:
        """Relative difference of the PSF's MTF50 from the edge's."""
        return self.by_psf.value / self.by_edge.value - 1

    @property
    def sigmas(self) -> float:
        """Difference in standard uncertainties."""
        spread = math.hypot(self.by_psf.uncertainty, self.by_edge.uncertainty)
        return (self.by_psf.value - self.by_edge.value) / spread


def check_edges(plane: Plane, psf_estimate: PatternPsf) -> tuple[EdgeCheck, ...]:
    """Compare each printed edge with the PSF; none where the photograph has no step of the chart's contrast, in their
    direction, white on the chart's side."""
    edges = [edge for i in range(len(EDGES)) if (edge := _measured(plane, psf_estimate, i)) is not None]
    pairs = [(edge, quantity_along(psf_estimate.psf, edge.normal_deg, psf_estimate.n)) for edge in edges]
    return tuple(EdgeCheck(edge, edge.numbers[EDGE_MTF50], by_psf) for edge, by_psf in pairs if by_psf is not None)


def _measured(plane: Plane, psf_estimate: PatternPsf, i: int) -> EdgeMtf | None:
    """MTF across one of the chart's edges; None where it is not visible or cannot be measured."""
    strip_and_line = _strip(plane, psf_estimate, i)
    if strip_and_line is None or not _shows_edge(*strip_and_line, psf_estimate):
        return None
    from procedures.slanted_edge.estimate import measure
    from procedures.slanted_edge.tail import Tail

    strip, line = strip_and_line
    first = measure(strip, line).value
    if first is None:
        return None
    density = psf_estimate.psf.tail_density_px
    alone = without_surroundings(plane.samples, strip, first.course, density)
    # the tail's line spread function is 2 A / d^2, the edge's approach to its plains 2 A / d
    edge = measure(replace(strip, samples=alone, tail=Tail(2 * density)), line).value
    other = measure(replace(strip, samples=alone, tail=Tail(2 * density * (1 + TAIL_INCREASE))), line).value
    if edge is None or EDGE_MTF50 not in edge.numbers or other is None or EDGE_MTF50 not in other.numbers:
        return None
    # add the uncertainty due to the tail to the edge's MTF50; `other` had a tail larger by `TAIL_INCREASE`
    mtf50 = edge.numbers[EDGE_MTF50]
    slope = (other.numbers[EDGE_MTF50].value - mtf50.value) / TAIL_INCREASE
    tail_uncertainty = slope * min(_tail_uncertainty(psf_estimate), 1.0)
    combined = replace(mtf50, uncertainty=math.hypot(mtf50.uncertainty, tail_uncertainty))
    edge = replace(edge, numbers={**edge.numbers, EDGE_MTF50: combined})
    cells = psf_estimate.registration.to_pattern(edge.course)
    across, along = cells[:, i], cells[:, 1 - i]
    start, end = EDGES[i]
    expected = start[i] + (end - start)[i] * along / CELLS
    max_offset = max(MAX_OFFSET_CELLS, MAX_OFFSET_PX / _cell_px(psf_estimate))
    return edge if np.abs(across - expected).max() < max_offset else None


def _tail_uncertainty(psf_estimate: PatternPsf) -> float:
    """Relative uncertainty of the tail's energy, noise and shape together; infinite where there is none."""
    tail = psf_estimate.psf.tail
    noise = float(tail.covariance[0, 0]) ** 0.5 / abs(float(tail.amplitudes[0])) if tail.amplitudes[0] else math.inf
    return math.hypot(noise, TAIL_SHAPE_UNCERTAINTY)


def _cell_px(psf_estimate: PatternPsf) -> float:
    return 1 / math.sqrt(abs(np.linalg.det(psf_estimate.registration.jacobian())))


def _strip(plane: Plane, psf_estimate: PatternPsf, i: int) -> tuple[Strip, EdgeLine] | None:
    """Strip of an edge by the map, with other printed areas masked, and its line; None outside the frame."""
    registration = psf_estimate.registration
    cell_px = _cell_px(psf_estimate)
    margin = MARGIN_PX / cell_px
    start, end = EDGES[i]
    inset = (end - start) / np.linalg.norm(end - start) * margin
    ends = registration.to_sensor(np.array([start + inset, end - inset]))
    limit = np.array(plane.samples.shape[::-1]) - 1
    if not (np.isfinite(ends).all() and (ends > MARGIN_PX).all() and (ends < limit - MARGIN_PX).all()):
        return None
    # imported late, as most charts have no edges
    from procedures.slanted_edge.find import strip_along
    from procedures.slanted_edge.strip import MIN_SIDE

    reach = WIDEST_BLOCKS * BLOCK * cell_px
    strip, line = strip_along(plane.samples, ends[0], ends[1], reach)
    if min(strip.samples.shape) < MIN_SIDE:
        return None
    roi = strip.roi
    x, y = np.meshgrid(roi.x + np.arange(roi.width), roi.y + np.arange(roi.height))
    cells = registration.to_pattern(np.column_stack([x.ravel(), y.ravel()]).astype(np.float64))
    across, along = cells[:, i], cells[:, 1 - i]
    valid = (
        (across > CELLS + BLOCK + margin) & (across < EDGE_END - margin) & (along > margin) & (along < CELLS - margin)
    )
    shaped = valid.reshape(roi.height, roi.width)
    near = replace(line, near_px=max(MAX_OFFSET_PX, MAX_OFFSET_CELLS * cell_px))
    # processing changes PSF and edge alike: no part of their difference
    return replace(strip, valid=shaped.T if strip.turned else shaped, reach_px=reach, raw=True), near


def _shows_edge(strip: Strip, line: EdgeLine, psf_estimate: PatternPsf) -> bool:
    """Whether there is a step with the contrast of the chart's black and white."""
    from procedures.slanted_edge.strip import MIN_SIDE

    d = np.arange(strip.samples.shape[1]) - line.middle - line.slope * strip.along[:, None]
    sides = [strip.samples[strip.usable & (d * sign > MARGIN_PX)] for sign in (-1, 1)]
    if min(map(len, sides)) < MIN_SIDE**2 / 2:
        return False
    contrast = abs(quantile(sides[0], 0.5) - quantile(sides[1], 0.5))
    return contrast > MIN_CONTRAST * psf_estimate.diagnostics["contrast"]


# --- stray light on an edge ---
# The slanted-edge method assumes an edge between two unbounded plains. On the chart the frame is close, and the black
# area ends: a few thousandths of the contrast, which would be mistaken for the edge's own tail.

AROUND_PX = 64  # width of the surroundings included around a strip: the tail's light from beyond is uniform over it


def without_surroundings(samples: Array32, strip: Strip, course: Array, density_px: float) -> Array:
    """Samples (n, m) of a strip corrected to unbounded plains.

    samples : (rows, columns) float32 the plane, including the surroundings
    strip : valid samples cover the edge and its plains only
    course : (n, 2) points (x, y) of the plane along the edge
    density_px : coefficient A of the tail A / r^3, per square pixel, of a PSF of sum 1; r in pixels
    """
    roi = strip.roi
    x0, y0 = max(roi.x - AROUND_PX, 0), max(roi.y - AROUND_PX, 0)
    part = samples[y0 : roi.y + roi.height + AROUND_PX, x0 : roi.x + roi.width + AROUND_PX].astype(np.float64)
    top, left = roi.y - y0, roi.x - x0
    inside = np.zeros(part.shape, dtype=np.bool_)
    inside[top : top + roi.height, left : left + roi.width] = strip.usable.T if strip.turned else strip.usable
    y, x = np.mgrid[: part.shape[0], : part.shape[1]]
    u, v = (x + x0, y + y0) if strip.turned else (y + y0, x + x0)
    along, across = course.T if strip.turned else course.T[::-1]
    line = np.polyfit(along, across, 1)
    beyond = v > np.polyval(line, u)
    levels = [quantile(part[inside & side], 0.5) for side in (~beyond, beyond)]
    deviation = np.where(inside, 0.0, part - np.where(beyond, levels[1], levels[0]))
    # picture (rows, columns) convolved with A / r^3; zero beyond its border
    shape = [transforms.next_fast_len(2 * n) for n in deviation.shape]
    r = np.hypot(*(transforms.fftfreq(n, 1 / n).reshape(s) for n, s in zip(shape, ((-1, 1), (1, -1)), strict=True)))
    kernel = np.where(r > 0, density_px / np.maximum(r, 1) ** 3, 0.0)
    product = transforms.rfft2(deviation, shape) * transforms.rfft2(kernel)
    through_tail = np.asarray(transforms.irfft2(product, shape)[: deviation.shape[0], : deviation.shape[1]])
    stray_light = through_tail[top : top + roi.height, left : left + roi.width]
    return strip.samples - (stray_light.T if strip.turned else stray_light)
