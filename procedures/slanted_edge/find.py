"""Detection of edges in a plane: straight segments with uniform areas on both sides."""

from dataclasses import dataclass

import cv2
import numpy as np

from procedures.numerics.arrays import Array, Array32
from procedures.outcome import Refused
from procedures.slanted_edge.strip import EdgeLine, Roi, Strip, strip_of

MIN_LENGTH_PX = 24.0
MIN_ANGLE_DEG, MAX_ANGLE_DEG = 2.0, 43.0
"""Angles from the nearest axis beyond which an edge of this length does not cross all phases of the pixels."""
MIN_REACH_PX, MAX_REACH_PX = 6.0, 40.0  # width of the plain areas on either side
CORE_PX = 5.0  # distance from the edge at which plains begin
UNEVEN = 0.08  # change, relative to the edge's contrast, at which a plain area ends
END_PX = 3.0  # length excluded at an edge's ends, in addition to that due to its slant
MIN_CONTRAST = 0.02  # least contrast, relative to white
MAX_SEGMENTS = 600  # number of segments examined, the longest first; textures have any number
NOISE_LEVELS = 1.5  # noise, in 256ths, to which the picture is smoothed before segments are detected


@dataclass(frozen=True, eq=False)
class EdgeSighting:
    """A detected edge: its strip, and the line along it."""

    strip: Strip
    line: EdgeLine
    score: float


@dataclass(frozen=True, eq=False)
class _Segment:
    """A straight segment between two points (x, y)."""

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
        """Angle from the nearest axis, 0 to 45."""
        x, y = np.abs(self.direction)
        return float(np.degrees(np.arctan2(min(x, y), max(x, y))))


def find_edges(samples: Array32) -> list[EdgeSighting]:
    """Detect the slanted edges of a plane, the best first. Raises Refused if there is none, with the reason."""
    segments = _merged(_segments(samples))
    slanted = [segment for segment in segments if MIN_ANGLE_DEG <= segment.angle_deg <= MAX_ANGLE_DEG]
    detected = [edge for one in slanted if (edge := _sighting(samples, one)) is not None]
    if not detected:
        raise Refused(*_why_none(segments, slanted))
    kept: list[EdgeSighting] = []
    for sighting in sorted(detected, key=lambda one: -one.score):
        if not any(_same(sighting, other) for other in kept):
            kept.append(sighting)
    return kept


def longest_segment(samples: Array32) -> Array | None:
    """Ends (2, 2) of the longest straight segment at any angle, as x and y; None without one."""
    segments = _merged(_segments(samples))
    return np.array([segments[0].start, segments[0].end]) if segments else None


def edge_listed(samples: Array32, roi: Roi) -> EdgeSighting | None:
    """The edge that `find_edges` gives this region, or None."""
    try:
        return next((edge for edge in find_edges(samples) if edge.strip.roi == roi), None)
    except Refused:
        return None


def _why_none(segments: list[_Segment], slanted: list[_Segment]) -> tuple[str, str]:
    if slanted:
        return (
            "no edge has plain areas on both sides, 6 pixels wide and 16 long or more",
            "photograph an edge between two plain areas, or name it with --roi",
        )
    if segments:
        angle = max(segments, key=lambda one: one.length).angle_deg
        kind = "the axes of the pixels" if angle < MIN_ANGLE_DEG else "the diagonal"
        return (
            f"an edge must run through all phases of the pixels; the longest lies at {angle:.1f} degrees, too near "
            f"{kind}",
            "turn the chart or the camera: 5 degrees from an axis are right",
        )
    return "there is no straight edge in the photograph", "photograph a straight edge between two plain areas, in focus"


def _segments(samples: Array32) -> list[_Segment]:
    """Segments of strong gradients, their brighter side on the right, the longest first."""
    if min(samples.shape) < 2:
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
    segments = [_Segment(a, b) for a, b in ends if np.hypot(*(b - a)) > MIN_LENGTH_PX / 3]
    return sorted(segments, key=lambda one: -one.length)


def _merged(segments: list[_Segment]) -> list[_Segment]:
    """Segments joined where they continue each other, without the short ones."""
    joined: list[_Segment] = []
    remaining = segments[:MAX_SEGMENTS]
    while remaining:
        whole = remaining.pop(0)
        while (i := _continuation(whole, remaining)) is not None:
            # segment from the first end of both to the last, along a
            b = remaining.pop(i)
            points = np.array([whole.start, whole.end, b.start, b.end])
            places = (points - whole.start) @ whole.direction
            whole = _Segment(points[np.argmin(places)], points[np.argmax(places)])
        if whole.length >= MIN_LENGTH_PX:
            joined.append(whole)
    return joined


def _continuation(a: _Segment, others: list[_Segment]) -> int | None:
    """Index of a segment on the line of a, in its direction, next to it; None if there is none."""
    if not others:
        return None
    starts, ends = np.array([b.start for b in others]) - a.start, np.array([b.end for b in others]) - a.start
    along = a.direction
    normal = np.array([-along[1], along[0]])
    length = np.linalg.norm(ends - starts, axis=1)
    parallel = (ends - starts) @ along > np.cos(np.radians(2)) * length
    gap = np.maximum(starts @ along - a.length, -(ends @ along))
    aside = np.maximum(np.abs(starts @ normal), np.abs(ends @ normal))
    detected = np.flatnonzero(parallel & (gap < 10) & (aside < 2))
    return int(detected[0]) if len(detected) else None


def _sighting(samples: Array32, segment: _Segment) -> EdgeSighting | None:
    """The edge of a segment with its plain areas; None where they are too small."""
    band = _band(samples, segment)
    beside = [band[int(MAX_REACH_PX + d)] for d in (CORE_PX, -CORE_PX)]
    bright, dark = (float(np.median(line[np.isfinite(line)])) if np.isfinite(line).any() else np.nan for line in beside)
    contrast = abs(bright - dark)
    if not contrast >= MIN_CONTRAST:
        return None
    sides = [_plain_px(band[int(MAX_REACH_PX) :: step], contrast) for step in (1, -1)]
    reach = min(sides)
    inset = END_PX + reach * np.sin(np.radians(segment.angle_deg))
    length = segment.length - 2 * inset
    if reach < MIN_REACH_PX or length < 16:
        return None
    start, end = segment.start + inset * segment.direction, segment.end - inset * segment.direction
    strip, line = strip_along(samples, start, end, reach)
    return EdgeSighting(strip, line, contrast * length**0.5)


def _band(samples: Array32, segment: _Segment) -> Array:
    """The plane along lines parallel to the segment, (2 reach + 1, length); row `reach` is the segment itself."""
    from scipy.ndimage import map_coordinates  # here: a known edge needs none of it

    along = segment.direction
    normal = np.array([-along[1], along[0]])
    t = np.arange(END_PX, max(segment.length - END_PX, END_PX + 1))
    d = np.arange(-MAX_REACH_PX, MAX_REACH_PX + 1)
    points = segment.start + t[None, :, None] * along + d[:, None, None] * normal
    return np.asarray(map_coordinates(samples, [points[..., 1], points[..., 0]], order=1, cval=np.nan), np.float64)


def _plain_px(side: Array, contrast: float) -> float:
    """Distance from the edge at which a side ceases to be plain: where the mean of a quarter of a line changes fast."""
    pieces = np.stack([_mean_inside(piece) for piece in np.array_split(side, 4, axis=1)], axis=1)
    core = int(CORE_PX)
    typical = np.median(pieces[core : core + 4], axis=0)
    off = np.max(np.abs(pieces - typical), axis=1)
    slow = UNEVEN * contrast * (1 + np.arange(len(side)) / MAX_REACH_PX)
    wrong = np.flatnonzero(~(off[core:] < slow[core:]))
    return float(core + wrong[0] - 1) if len(wrong) else float(len(side) - 1)


def _mean_inside(lines: Array) -> Array:
    """Means (n,) of lines (n, m) inside the picture, as an oblique edge cuts them; NaN for less than a quarter."""
    inside = np.isfinite(lines)
    count = np.count_nonzero(inside, axis=1)
    total = np.sum(np.where(inside, lines, 0.0), axis=1)
    return np.where(4 * count >= lines.shape[1], total / np.maximum(count, 1), np.nan)


def strip_along(samples: Array32, start: Array, end: Array, reach: float) -> tuple[Strip, EdgeLine]:
    """The strip between two points of an edge, and the line between them in it."""
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


def _same(a: EdgeSighting, b: EdgeSighting) -> bool:
    (x, y), (x0, y0) = _centre(a), _centre(b)
    if a.strip.turned != b.strip.turned:
        return False
    along, across = (x - x0, y - y0) if a.strip.turned else (y - y0, x - x0)
    return bool(abs(across - b.line.slope * along) < 4 and abs(along) < len(b.strip.samples) / 2)


def _centre(one: EdgeSighting) -> tuple[float, float]:
    """Middle (x, y) of the line in the plane."""
    roi, half = one.strip.roi, (len(one.strip.samples) - 1) / 2
    return (roi.x + half, roi.y + one.line.middle) if one.strip.turned else (roi.x + one.line.middle, roi.y + half)
