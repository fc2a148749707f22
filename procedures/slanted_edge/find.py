"""Edges found in a plane: straight segments, long enough, with plain areas on both sides."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from procedures.outcome import Refused
from procedures.slanted_edge.strip import Array, Array32, EdgeLine, Roi, Strip, strip_of

LEAST_LENGTH_PX = 24.0
LEAST_ANGLE_DEG, MOST_ANGLE_DEG = 2.0, 43.0
"""From the nearest axis: outside of them no edge runs through all phases of the pixels, at these lengths."""
LEAST_REACH_PX, MOST_REACH_PX = 6.0, 40.0
"""Of the plain areas on either side."""
CORE_PX = 5.0
"""Around the edge, where nothing is plain."""
UNEVEN = 0.08
"""Change of a plain area, in units of the edge's contrast, that ends it."""
END_PX = 3.0
"""What is left out at an edge's ends, beside what its slant asks for."""
LEAST_CONTRAST = 0.02
"""Of the plane's scale."""
MOST_SEGMENTS = 600
"""The longest that are looked at: textures have any number."""
NOISE_LEVELS = 1.5
"""Noise, in 256ths, to which the picture is smoothed before segments are looked for."""


@dataclass(frozen=True, eq=False)
class EdgeSighting:
    """An edge that was found: its strip, and the line along it."""

    strip: Strip
    line: EdgeLine
    score: float


@dataclass(frozen=True, eq=False)
class _Segment:
    """A straight segment: its ends (x, y)."""

    start: Array
    end: Array

    @property
    def length(self) -> float:
        return float(np.hypot(*(self.end - self.start)))

    @property
    def direction(self) -> Array:
        return np.asarray((self.end - self.start) / self.length)

    @property
    def angle_deg(self) -> float:
        """From the nearest axis, 0 to 45."""
        x, y = np.abs(self.direction)
        return float(np.degrees(np.arctan2(min(x, y), max(x, y))))


def find_edges(samples: Array32) -> list[EdgeSighting]:
    """The slanted edges of a plane, the best first.

    Raises
    ------
    Refused
        If there is none, with what is nearest to one.
    """
    segments = _merged(_segments(samples))
    slanted = [one for one in segments if LEAST_ANGLE_DEG <= one.angle_deg <= MOST_ANGLE_DEG]
    found = [sighting for one in slanted if (sighting := _sighting(samples, one)) is not None]
    if not found:
        raise Refused(*_why_none(segments, slanted))
    return _apart(sorted(found, key=lambda one: -one.score))


def edge_listed(samples: Array32, roi: Roi) -> EdgeSighting | None:
    """The edge that `find_edges` gives this very region; None where it gives it to none."""
    try:
        return next((one for one in find_edges(samples) if one.strip.roi == roi), None)
    except Refused:
        return None


def _why_none(segments: list[_Segment], slanted: list[_Segment]) -> tuple[str, str]:
    """What is missing, and what helps."""
    if slanted:
        return (
            "no edge has plain areas on both sides, 6 pixels wide and 16 long or more",
            "photograph an edge between two plain areas, or name it with --roi",
        )
    if segments:
        angle = max(segments, key=lambda one: one.length).angle_deg
        kind = "the axes of the pixels" if angle < LEAST_ANGLE_DEG else "the diagonal"
        return (
            f"an edge must run through all phases of the pixels; the longest lies at {angle:.1f} degrees, too near "
            f"{kind}",
            "turn the chart or the camera: 5 degrees from an axis are right",
        )
    return "there is no straight edge in the photograph", "photograph a straight edge between two plain areas, in focus"


def _segments(samples: Array32) -> list[_Segment]:
    """Segments of strong gradients, with the brighter side on their right."""
    if min(samples.shape) < 2:  # it has no gradients
        return []
    top = float(np.quantile(samples, 0.999))
    picture = np.clip(samples * (255 / max(top, 1e-6)), 0, 255).astype(np.float32)
    noise = 1.4826 * float(np.median(np.abs(np.diff(picture, axis=1) - np.median(np.diff(picture, axis=1))))) / 2**0.5
    sigma = float(np.clip(noise / (2 * np.pi**0.5 * NOISE_LEVELS), 1.0, 4.0))
    smooth = cv2.GaussianBlur(picture, (0, 0), sigma)
    lines = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD).detect(np.rint(smooth).astype(np.uint8))[0]
    if lines is None:
        return []
    ends = np.asarray(lines, dtype=np.float64).reshape(-1, 2, 2)
    segments = [_Segment(a, b) for a, b in ends if np.hypot(*(b - a)) > LEAST_LENGTH_PX / 3]
    return sorted(segments, key=lambda one: -one.length)


def _merged(segments: list[_Segment]) -> list[_Segment]:
    """Segments that continue each other joined, the short ones left out."""
    joined: list[_Segment] = []
    left = segments[:MOST_SEGMENTS]
    while left:
        whole = left.pop(0)
        while (i := _continuation(whole, left)) is not None:
            whole = _joined(whole, left.pop(i))
        if whole.length >= LEAST_LENGTH_PX:
            joined.append(whole)
    return joined


def _continuation(a: _Segment, others: list[_Segment]) -> int | None:
    """Which of others lies on the line of a, in its direction, and all but touches it; None if none does."""
    if not others:
        return None
    starts, ends = np.array([b.start for b in others]) - a.start, np.array([b.end for b in others]) - a.start
    along = a.direction
    normal = np.array([-along[1], along[0]])
    length = np.linalg.norm(ends - starts, axis=1)
    parallel = (ends - starts) @ along > np.cos(np.radians(2)) * length
    gap = np.maximum(starts @ along - a.length, -(ends @ along))
    aside = np.maximum(np.abs(starts @ normal), np.abs(ends @ normal))
    found = np.flatnonzero(parallel & (gap < 10) & (aside < 2))
    return int(found[0]) if len(found) else None


def _joined(a: _Segment, b: _Segment) -> _Segment:
    """From the first end of both to the last, along a."""
    points = np.array([a.start, a.end, b.start, b.end])
    places = (points - a.start) @ a.direction
    return _Segment(points[np.argmin(places)], points[np.argmax(places)])


def _sighting(samples: Array32, segment: _Segment) -> EdgeSighting | None:
    """The edge of a segment with its plain areas, None where they are too small."""
    band = _band(samples, segment)
    beside = [band[int(MOST_REACH_PX + d)] for d in (CORE_PX, -CORE_PX)]
    bright, dark = (float(np.median(line[np.isfinite(line)])) if np.isfinite(line).any() else np.nan for line in beside)
    contrast = abs(bright - dark)
    if not contrast >= LEAST_CONTRAST:
        return None
    sides = [_plain_px(band[int(MOST_REACH_PX) :: step], contrast) for step in (1, -1)]
    reach = min(sides)
    inset = END_PX + reach * np.sin(np.radians(segment.angle_deg))
    length = segment.length - 2 * inset
    if reach < LEAST_REACH_PX or length < 16:
        return None
    start, end = segment.start + inset * segment.direction, segment.end - inset * segment.direction
    strip, line = strip_along(samples, start, end, reach)
    return EdgeSighting(strip, line, contrast * length**0.5)


def _band(samples: Array32, segment: _Segment) -> Array:
    """The plane read along lines beside the segment, (2 reach + 1, length): row `reach` is the segment itself."""
    from scipy.ndimage import map_coordinates  # who knows where the edge is needs none of it

    along = segment.direction
    normal = np.array([-along[1], along[0]])
    t = np.arange(END_PX, max(segment.length - END_PX, END_PX + 1))
    d = np.arange(-MOST_REACH_PX, MOST_REACH_PX + 1)
    points = segment.start + t[None, :, None] * along + d[:, None, None] * normal
    return np.asarray(map_coordinates(samples, [points[..., 1], points[..., 0]], order=1, cval=np.nan), np.float64)


def _plain_px(side: Array, contrast: float) -> float:
    """How far from the edge a side stays plain: the lines' means change slowly, and so do parts of each."""
    pieces = np.stack([_mean_inside(piece) for piece in np.array_split(side, 4, axis=1)], axis=1)
    core = int(CORE_PX)
    typical = np.median(pieces[core : core + 4], axis=0)
    off = np.max(np.abs(pieces - typical), axis=1)
    slow = UNEVEN * contrast * (1 + np.arange(len(side)) / MOST_REACH_PX)
    wrong = np.flatnonzero(~(off[core:] < slow[core:]))
    return float(core + wrong[0] - 1) if len(wrong) else float(len(side) - 1)


def _mean_inside(lines: Array) -> Array:
    """Means (n,) of lines (n, m) over what of them is inside the picture, NaN where that is less than a quarter: beside
    an edge that leaves the picture aslant they are cut on one side, and rows or columns across it are whole."""
    inside = np.isfinite(lines)
    count = np.count_nonzero(inside, axis=1)
    total = np.sum(np.where(inside, lines, 0.0), axis=1)
    return np.where(4 * count >= lines.shape[1], total / np.maximum(count, 1), np.nan)


def strip_along(samples: Array32, start: Array, end: Array, reach: float) -> tuple[Strip, EdgeLine]:
    """The strip from one point of an edge to another, and the line between them in it."""
    turned = bool(abs(end - start)[0] > abs(end - start)[1])
    # u runs along the edge, v across it
    u, v = (0, 1) if turned else (1, 0)
    first, last = (start, end) if start[u] < end[u] else (end, start)
    sizes = samples.shape[1], samples.shape[0]
    low_u, high_u = max(int(np.ceil(first[u])), 0), min(int(np.floor(last[u])), sizes[u] - 1)
    wide = reach * 1.1 / np.cos(np.arctan2(abs(last - first)[v], abs(last - first)[u])) + 2
    low_v = max(int(np.floor(min(first[v], last[v]) - wide)), 0)
    high_v = min(int(np.ceil(max(first[v], last[v]) + wide)), sizes[v] - 1)
    corner, size = np.zeros(2, dtype=int), np.zeros(2, dtype=int)
    corner[[u, v]], size[[u, v]] = (low_u, low_v), (high_u - low_u + 1, high_v - low_v + 1)
    roi = Roi(int(corner[0]), int(corner[1]), int(size[0]), int(size[1]))
    slope = float((last - first)[v] / (last - first)[u])
    middle = float(first[v] + slope * ((low_u + high_u) / 2 - first[u]) - low_v)
    return strip_of(samples, roi, turned=turned, reach_px=reach), EdgeLine(middle, slope)


def _apart(sightings: list[EdgeSighting]) -> list[EdgeSighting]:
    """Without those that lie on a better one's line."""
    kept: list[EdgeSighting] = []
    for one in sightings:
        if not any(_same(one, other) for other in kept):
            kept.append(one)
    return kept


def _same(a: EdgeSighting, b: EdgeSighting) -> bool:
    """Whether a's middle lies on b."""
    (x, y), (x0, y0) = _centre(a), _centre(b)
    if a.strip.turned != b.strip.turned:
        return False
    along, across = (x - x0, y - y0) if a.strip.turned else (y - y0, x - x0)
    return bool(abs(across - b.line.slope * along) < 4 and abs(along) < len(b.strip.samples) / 2)


def _centre(one: EdgeSighting) -> tuple[float, float]:
    """(x, y) of the line's middle in the plane."""
    roi, half = one.strip.roi, (len(one.strip.samples) - 1) / 2
    return (roi.x + half, roi.y + one.line.middle) if one.strip.turned else (roi.x + one.line.middle, roi.y + half)
