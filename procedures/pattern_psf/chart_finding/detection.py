"""The charts in a photograph: where their x-corners are, which way they turn, and how sure that is.

Coarse to fine: saddles at each level of a pyramid, sets of them that lie like the marks, the frame's blocks and
triangles to tell chart from clutter and one turn from the other seven, the marks' places at full resolution.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from procedures.outcome import BadInput, Refused
from procedures.pattern import BLOCK, CELLS, X_CORNERS
from procedures.pattern_psf.chart_finding import chart_frame
from procedures.pattern_psf.chart_finding.corner_layouts import find_layouts
from procedures.pattern_psf.chart_finding.marks import find_saddles

MIN_WIDTH, MAX_WIDTH = 60.0, 300.0
"""Widths of the noise region that the estimator works with, in pixels."""
TOLERANCE = 1.06
"""Widths are known to this factor: a tilted chart has no one width."""
MAX_HIDDEN = 2
SCREENED = 0.4
"""Agreement that a set of saddles must show before its marks are placed."""
MOST_SETTLED = 60
"""Candidates per level whose marks are placed."""
ACCEPTED = 0.75
"""Agreement of a chart; clutter that lies like the marks stays below."""
LIKENESS = 0.6
"""Normalised correlation of a visible mark with what it should look like."""
PLACE_TOLERANCE = 0.08
"""Greatest distance of a mark from the homography of the others, in blocks: lens distortion is less."""
PLACE_NOISE = 0.6
"""The same in pixels, where it is more: noise, and what hides a part of a small mark."""
PLACINGS = 3
"""Times that the marks are placed, each with the map of the last."""
PLACED_BLOCK = 12
"""Marks are placed on the coarsest level whose blocks have this many pixels."""
MIN_VISIBLE = 6
"""Marks in sight, of 12, that tell a chart from clutter."""
MARGIN = 0.1
"""By how much the best turn must agree better than any other."""
SMALLEST_LEVEL = 48
"""The pyramid ends before a side gets shorter than this."""
Image = npt.NDArray[np.float32]
Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class ChartSighting:
    """One chart found in a photograph.

    Attributes
    ----------
    corners : (12, 2) float64
        (x, y) of the x-corners in pixels of the plane, in the order of `pattern.X_CORNERS`, NaN where hidden.
    H_sensor_pattern : (3, 3) float64
        Homography from cells to pixels, fitted to the corners found.
    visible : (12,) bool
        Which corners were found.
    score : float
        Agreement of the frame's blocks and triangles with the picture, 0 to 1; the noise cells have no part in it.
    mirrored : bool
        Whether the photograph shows the chart as in a mirror.
    negative : bool
        Whether it shows white for black: the frame then looks much as in a mirror, and H turns it over, too.
    """

    corners: Array
    H_sensor_pattern: Array
    visible: npt.NDArray[np.bool_]
    score: float
    mirrored: bool
    negative: bool

    def sure(self) -> bool:
        """Whether enough marks are in sight that no other map of the same chart could have more."""
        return int(np.count_nonzero(self.visible)) >= len(X_CORNERS) - MAX_HIDDEN

    def predicted(self) -> Array:
        """(x, y) of all twelve x-corners by the homography, (12, 2)."""
        return chart_frame.transform(self.H_sensor_pattern, X_CORNERS)

    def centre(self) -> Array:
        """(x, y) of the noise region's centre."""
        return _centre(self.H_sensor_pattern)

    def widths(self) -> Array:
        """Lengths of the noise region's four sides in pixels, (4,)."""
        square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float64) * CELLS
        corners = chart_frame.transform(self.H_sensor_pattern, square)
        out: Array = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
        return out

    def moved(self, x: float, y: float) -> ChartSighting:
        """The same chart in a plane where everything appears so many pixels further right and down."""
        T = np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])
        return replace(self, corners=self.corners + np.array([x, y]), H_sensor_pattern=T @ self.H_sensor_pattern)

    def reduced(self, factor: int) -> ChartSighting:
        """The same chart in the means over squares of `factor` x `factor` pixels."""
        H = np.linalg.inv(_to_full(factor)) @ self.H_sensor_pattern
        return replace(self, corners=(self.corners - (factor - 1) / 2) / factor, H_sensor_pattern=H)

    def cut_marks(self, shape: tuple[int, ...], margin_px: float = 0.0) -> int:
        """How many x-corners lie nearer to the edge of a photograph of this shape (rows, columns), or beyond it."""
        x, y = self.predicted().T
        inside = (x >= margin_px) & (y >= margin_px)
        inside &= (x <= shape[1] - 1 - margin_px) & (y <= shape[0] - 1 - margin_px)
        return int(np.count_nonzero(~inside))


def _to_full(factor: int) -> Array:
    """Homography from the pixels of a level, each the mean of factor x factor, to those of the photograph."""
    shift = (factor - 1) / 2
    return np.array([[factor, 0, shift], [0, factor, shift], [0, 0, 1]], dtype=np.float64)


def _pyramid(image: Image) -> Iterator[tuple[int, Image]]:
    """Levels of the picture, (factor, means over factor x factor pixels), from full resolution down."""
    factor, level = 1, image
    while min(level.shape) >= SMALLEST_LEVEL:
        yield factor, level
        factor *= 2
        level = np.asarray(
            cv2.resize(level[: level.shape[0] // 2 * 2, : level.shape[1] // 2 * 2], None, fx=0.5, fy=0.5,
                       interpolation=cv2.INTER_AREA), dtype=np.float32)  # fmt: skip


def _candidates(level: Image) -> Iterator[Array]:
    """Homographies from cells to the level's pixels, turned as the frame tells, the best agreement first."""
    layouts = find_layouts(find_saddles(level))
    scores = chart_frame.screen(level, layouts)
    best = scores.argmax(axis=1)
    scores = scores.max(axis=1)
    for n in np.argsort(-scores, kind="stable")[:MOST_SETTLED]:
        if scores[n] > SCREENED:
            yield layouts.maps[n] @ np.linalg.inv(chart_frame.symmetries()[best[n]][0])


def _homography(pixels: Array, chosen: npt.NDArray[np.bool_], tolerance: float) -> Array | None:
    """Homography from cells to the chosen marks' pixels; tolerance 0 fits all, else those that agree within it."""
    if np.count_nonzero(chosen) < MIN_VISIBLE:
        return None
    H, _ = cv2.findHomography(X_CORNERS[chosen], pixels[chosen], cv2.RANSAC if tolerance else 0, tolerance)
    return None if H is None else np.asarray(H, dtype=np.float64)


def _settle(levels: list[tuple[int, Image]], start: Array) -> ChartSighting | None:
    """The chart near a homography from cells to pixels, its marks placed and everything checked."""
    block = BLOCK * np.sqrt(abs(np.linalg.det(_jacobian(start))))
    factor, level = levels[int(np.clip(np.log2(block / PLACED_BLOCK), 0, len(levels) - 1))]
    to_level = np.linalg.inv(_to_full(factor))
    tolerance = max(PLACE_TOLERANCE * block, PLACE_NOISE)
    H = start
    for _ in range(PLACINGS):
        placed = chart_frame.place_marks(chart_frame.rectify(level, to_level @ H))
        pixels, visible = chart_frame.transform(H, placed.cells), placed.likeness > LIKENESS
        if (better := _homography(pixels, visible, tolerance)) is None:
            return None
        H = better
    visible &= np.linalg.norm(chart_frame.transform(H, X_CORNERS) - pixels, axis=1) < tolerance
    if (best := _homography(pixels, visible, 0.0)) is None:
        return None
    rectified = chart_frame.rectify(level, to_level @ best)
    score = _sure_score(rectified, visible)
    if score < ACCEPTED:
        return None
    corners = np.where(visible[:, None], pixels, np.nan)
    turned_over = bool(np.linalg.det(_jacobian(best)) < 0)
    negative = turned_over and _frame_scores(-rectified, visible).max() > score
    return ChartSighting(corners, best / best[2, 2], visible, score, turned_over and not negative, bool(negative))


def _centre(H: Array) -> Array:
    """(x, y) of the noise region's centre."""
    out: Array = chart_frame.transform(H, np.full((1, 2), CELLS / 2))[0]
    return out


def _jacobian(H: Array) -> Array:
    """Derivative of the map from cells to pixels at the chart's centre, (2, 2)."""
    p = H @ np.array([CELLS / 2, CELLS / 2, 1.0])
    out: Array = (H[:2, :2] - np.outer(p[:2] / p[2], H[2, :2])) / p[2]
    return out


def _sure_score(rectified: Image, visible: npt.NDArray[np.bool_]) -> float:
    """Agreement where nothing hides the frame; 0 unless it is clearly better than for any other turn."""
    scores = _frame_scores(rectified, visible)
    return float(scores[0]) if scores[0] - scores[1:].max() > MARGIN else 0.0


def _frame_scores(rectified: Image, visible: npt.NDArray[np.bool_]) -> Array:
    """Agreement with the frame's eight turns where nothing hides it, (8,)."""
    where = chart_frame.ring() & ~chart_frame.around_marks(~visible)
    return chart_frame.agreements(rectified, chart_frame.turned_frames(), where)


def find_charts(image: npt.NDArray[np.floating]) -> list[ChartSighting]:
    """The charts in a photograph, the most marks in best agreement first; also mirrored, partly hidden and cut ones.

    Parameters
    ----------
    image : (rows, columns) float
        One linear grey plane, black 0, white 1 (any positive scale will do).

    Raises
    ------
    BadInput
        If it has not two dimensions.
    """
    if image.ndim != 2:
        raise BadInput(f"detection needs one grey plane; got an array of shape {image.shape}", "choose one plane")
    levels = list(_pyramid(np.ascontiguousarray(image, dtype=np.float32)))
    found: list[ChartSighting] = []
    for factor, level in levels:
        for H in _candidates(level):
            at_full = _to_full(factor) @ H
            if not _known(_centre(at_full), [s for s in found if s.sure()]):
                sighting = _settle(levels, at_full)
                if sighting is not None:
                    found.append(sighting)
    return _apart(sorted(found, key=lambda s: -s.score * s.visible.sum()))


def _apart(found: list[ChartSighting]) -> list[ChartSighting]:
    """The first of those that overlap; a side of one chart can pass for the opposite side of another."""
    kept: list[ChartSighting] = []
    for sighting in found:
        if not _known(sighting.centre(), kept) and not any(_share_marks(sighting, s) for s in kept):
            kept.append(sighting)
    return kept


def _share_marks(one: ChartSighting, other: ChartSighting) -> bool:
    """Whether two sightings have x-corners in common, which two charts cannot."""
    a, b = one.corners[one.visible], other.corners[other.visible]
    near = np.linalg.norm(a[:, None] - b, axis=2) < other.widths().min() * BLOCK / CELLS / 4
    return bool(near.any())


def _known(centre: Array, found: list[ChartSighting]) -> bool:
    """Whether a chart with its centre there would overlap one that was found."""
    return any(np.linalg.norm(s.centre() - centre) < s.widths().min() / 2 for s in found)


def find_chart(image: npt.NDArray[np.floating]) -> ChartSighting:
    """The one chart in a photograph.

    Raises
    ------
    Refused
        If there is none, more than one, a mirrored one, a negative, one that is cut by the photograph's edge or hidden
        at more than two marks, or one whose noise region is too small or too large.
    """
    found = one_chart(find_charts(image))
    check_usable(found, image.shape)
    return found


def one_chart(found: list[ChartSighting]) -> ChartSighting:
    """The one of the charts found. Raises Refused where there is none, or more than one."""
    if not found:
        raise Refused(
            "no chart in the photograph: nothing has the twelve x-corners and the blocks of its frame",
            "show the whole chart, sharp and evenly lit, its noise region 60 to 300 pixels wide",
        )
    if len(found) > 1:
        places = ", ".join(f"({x:.0f}, {y:.0f})" for x, y in (s.centre() for s in found))
        raise Refused(f"one chart is needed; got {len(found)}, centred at {places}", "cover or crop away the others")
    return found[0]


def check_usable(sighting: ChartSighting, shape: tuple[int, ...]) -> None:
    """Raise Refused for a chart that the estimator cannot use, in a photograph of this shape; see `find_chart`."""
    if sighting.negative:
        raise Refused(
            "the photograph is a negative: it shows the chart's white as black",
            "exchange white and black of the picture, or of the print",
        )
    if sighting.mirrored:
        raise Refused("the chart is mirrored", "flip the picture left to right, or photograph the chart directly")
    hidden = int(np.count_nonzero(~sighting.visible))
    half_block = sighting.widths().mean() * BLOCK / CELLS / 2
    cut = sighting.cut_marks(shape, half_block if hidden > MAX_HIDDEN else 0.0)
    if cut:
        raise Refused(
            f"the chart is cut by the photograph's edge: {cut} of its 12 marks are not whole in it",
            "aim so that the whole chart is in the frame",
        )
    if hidden > MAX_HIDDEN:
        raise Refused(
            f"at most {MAX_HIDDEN} of the chart's 12 marks may be hidden; {hidden} are",
            "clear what stands or lies in front of the chart, and avoid hard shadows and glare on it",
        )
    widths = sighting.widths()
    if widths.max() * TOLERANCE < MIN_WIDTH:
        raise Refused(
            f"the noise region must be at least {MIN_WIDTH:.0f} pixels wide; it is {widths.mean():.0f}",
            f"move closer: to {widths.mean() / MIN_WIDTH:.2f} of the distance or less, or print a larger chart",
        )
    if widths.min() / TOLERANCE > MAX_WIDTH:
        raise Refused(
            f"the noise region must be at most {MAX_WIDTH:.0f} pixels wide; it is {widths.mean():.0f}",
            f"move back {widths.mean() / MAX_WIDTH:.1f}x or more, or print a smaller chart",
        )
