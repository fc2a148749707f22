"""Detection of the charts in a photograph: positions of their x-corners, orientation, and score.

Coarse to fine: saddles at each level of a pyramid, sets of them in the layout of the marks, the frame's blocks and
triangles to reject clutter and to choose one of eight orientations, the marks' positions at full resolution.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from procedures.numerics.arrays import Array, Array32, Mask
from procedures.numerics.warps import apply_homography, homography_jacobian
from procedures.outcome import BadInput, Refused
from procedures.pattern import BLOCK, CELLS, X_CORNERS
from procedures.pattern_psf.chart_finding import chart_frame
from procedures.pattern_psf.chart_finding.corner_layouts import find_layouts
from procedures.pattern_psf.chart_finding.marks import find_saddles

MAX_WIDTH = 300.0
"""Greatest width of the noise region that the estimator accepts, in pixels; below 45 its marks are not found."""
TOLERANCE = 1.06  # tolerance of a width, as a factor: the width of a tilted chart varies
MAX_HIDDEN = 2
MIN_SCREENING = 0.4  # least coarse agreement with the frame of a candidate whose marks are located
MAX_CANDIDATES = 60  # greatest number of candidates per level whose marks are located
MIN_SCORE = 0.75  # least agreement of a chart; clutter in the layout of the marks stays below
MIN_CORRELATION = 0.6  # least normalised correlation of a visible mark with its template
POSITION_TOLERANCE = 0.08
"""Greatest distance of a mark from the homography of the others, in blocks: lens distortion is less."""
POSITION_NOISE_PX = 0.6  # least value of this distance in pixels, for noise and partly hidden small marks
LOCATING_STEPS = 3  # number of times that the marks are located, each with the map of the last
LOCATING_BLOCK_PX = 12  # pixels per block of the coarsest level on which marks are located
MIN_VISIBLE = 6  # least number of visible marks, of 12, that distinguish a chart from clutter
ORIENTATION_MARGIN = 0.1  # least difference in agreement between the best orientation and any other
SMALLEST_LEVEL = 48  # least side of a level of the pyramid
MIDDLE = np.full(2, CELLS / 2)


@dataclass(frozen=True)
class ChartSighting:
    """A chart detected in a photograph.

    corners : (12, 2) (x, y) of the x-corners in pixels of the plane, in the order of `pattern.X_CORNERS`, NaN where
        hidden
    H_sensor_pattern : (3, 3) homography from cells to pixels, fitted to the visible corners
    visible : (12,) bool mask of the detected corners
    score : agreement of the frame's blocks and triangles with the picture, 0 to 1; independent of the noise cells
    mirrored : whether the image is mirrored
    negative : whether black and white are exchanged: the frame then resembles its mirror image, and H mirrors it, too
    """

    corners: Array
    H_sensor_pattern: Array
    visible: Mask
    score: float
    mirrored: bool
    negative: bool

    def is_complete(self) -> bool:
        """Whether so many marks are visible that no other map of the same chart can have more."""
        return int(np.count_nonzero(self.visible)) >= len(X_CORNERS) - MAX_HIDDEN

    def predicted(self) -> Array:
        """(x, y) of all twelve x-corners by the homography, (12, 2)."""
        return apply_homography(self.H_sensor_pattern, X_CORNERS)

    def centre(self) -> Array:
        """(x, y) of the noise region's centre."""
        return _centre(self.H_sensor_pattern)

    def widths(self) -> Array:
        """Lengths of the noise region's four sides in pixels, (4,)."""
        square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float64) * CELLS
        corners = apply_homography(self.H_sensor_pattern, square)
        return np.asarray(np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1))

    def moved(self, x: float, y: float) -> "ChartSighting":
        """Sighting in a plane whose content is shifted by (x, y) pixels."""
        T = np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])
        return replace(self, corners=self.corners + np.array([x, y]), H_sensor_pattern=T @ self.H_sensor_pattern)

    def reduced(self, factor: int) -> "ChartSighting":
        """Sighting in the means over squares of `factor` x `factor` pixels."""
        H = np.linalg.inv(_to_full(factor)) @ self.H_sensor_pattern
        return replace(self, corners=(self.corners - (factor - 1) / 2) / factor, H_sensor_pattern=H)

    def cut_marks(self, shape: tuple[int, ...], margin_px: float = 0.0) -> int:
        """Number of x-corners within a margin of the border of a photograph of this shape, or beyond it."""
        x, y = self.predicted().T
        inside = (x >= margin_px) & (y >= margin_px)
        inside &= (x <= shape[1] - 1 - margin_px) & (y <= shape[0] - 1 - margin_px)
        return int(np.count_nonzero(~inside))


def _to_full(factor: int) -> Array:
    """Homography from the pixels of a level, each the mean of factor x factor, to those of the photograph."""
    shift = (factor - 1) / 2
    return np.array([[factor, 0, shift], [0, factor, shift], [0, 0, 1]], dtype=np.float64)


def _pyramid(image: Array32) -> Iterator[tuple[int, Array32]]:
    """Levels of the picture, (factor, means over factor x factor pixels), from full resolution down."""
    factor, level = 1, image
    while min(level.shape) >= SMALLEST_LEVEL:
        yield factor, level
        factor *= 2
        level = np.asarray(
            cv2.resize(level[: level.shape[0] // 2 * 2, : level.shape[1] // 2 * 2], None, fx=0.5, fy=0.5,
                       interpolation=cv2.INTER_AREA), dtype=np.float32)  # fmt: skip


def _candidates(level: Array32) -> Iterator[Array]:
    """Homographies from cells to the level's pixels, oriented by the frame, the best agreement first."""
    layouts = find_layouts(find_saddles(level))
    scores = chart_frame.screen(level, layouts)
    best = scores.argmax(axis=1)
    scores = scores.max(axis=1)
    for n in np.argsort(-scores, kind="stable")[:MAX_CANDIDATES]:
        if scores[n] > MIN_SCREENING:
            yield layouts.maps[n] @ np.linalg.inv(chart_frame.symmetries()[best[n]][0])


def _homography(pixels: Array, chosen: Mask, tolerance: float) -> Array | None:
    """Homography from cells to the chosen marks' pixels; tolerance 0 fits all, else those that agree within it."""
    if np.count_nonzero(chosen) < MIN_VISIBLE:
        return None
    H, _ = cv2.findHomography(X_CORNERS[chosen], pixels[chosen], cv2.RANSAC if tolerance else 0, tolerance)
    return None if H is None else np.asarray(H, dtype=np.float64)


def _verify(levels: list[tuple[int, Array32]], start: Array) -> ChartSighting | None:
    """Locate the marks near a homography from cells to pixels, and verify the chart; None for clutter."""
    block = BLOCK * np.sqrt(abs(np.linalg.det(homography_jacobian(start, MIDDLE))))
    factor, level = levels[int(np.clip(np.log2(block / LOCATING_BLOCK_PX), 0, len(levels) - 1))]
    to_level = np.linalg.inv(_to_full(factor))
    tolerance = max(POSITION_TOLERANCE * block, POSITION_NOISE_PX)
    H = start
    for _ in range(LOCATING_STEPS):
        cells, correlation = chart_frame.locate_marks(chart_frame.rectify(level, to_level @ H))
        pixels, visible = apply_homography(H, cells), correlation > MIN_CORRELATION
        if (better := _homography(pixels, visible, tolerance)) is None:
            return None
        H = better
    visible &= np.linalg.norm(apply_homography(H, X_CORNERS) - pixels, axis=1) < tolerance
    if (best := _homography(pixels, visible, 0.0)) is None:
        return None
    rectified = chart_frame.rectify(level, to_level @ best)
    # agreement with the visible frame; 0 unless it clearly exceeds that of any other orientation
    scores = _frame_scores(rectified, visible)
    score = float(scores[0]) if scores[0] - scores[1:].max() > ORIENTATION_MARGIN else 0.0
    if score < MIN_SCORE:
        return None
    corners = np.where(visible[:, None], pixels, np.nan)
    flipped = bool(np.linalg.det(homography_jacobian(best, MIDDLE)) < 0)
    negative = flipped and _frame_scores(-rectified, visible).max() > score
    return ChartSighting(corners, best / best[2, 2], visible, score, flipped and not negative, bool(negative))


def _centre(H: Array) -> Array:
    """(x, y) of the noise region's centre."""
    return np.asarray(apply_homography(H, MIDDLE[None])[0])


def _frame_scores(rectified: Array32, visible: Mask) -> Array:
    """Agreements (8,) with the visible frame in its eight orientations."""
    where = chart_frame.ring() & ~chart_frame.around_marks(~visible)
    return chart_frame.agreements(rectified, chart_frame.oriented_frames(), where)


def find_charts(image: npt.NDArray[np.floating]) -> list[ChartSighting]:
    """Detect the charts in a photograph, the best first; also mirrored, partly hidden and cut ones.

    image : (rows, columns) one linear grey plane, black 0, white 1; any positive scale is valid. Raises BadInput if the
    image is not two-dimensional.
    """
    if image.ndim != 2:
        raise BadInput(f"detection requires one grey plane; got an array of shape {image.shape}", "choose one plane")
    levels = list(_pyramid(np.ascontiguousarray(image, dtype=np.float32)))
    sightings: list[ChartSighting] = []
    for factor, level in levels:
        for H in _candidates(level):
            at_full = _to_full(factor) @ H
            if not _overlaps(_centre(at_full), [s for s in sightings if s.is_complete()]):
                sighting = _verify(levels, at_full)
                if sighting is not None:
                    sightings.append(sighting)
    return _without_overlaps(sorted(sightings, key=lambda s: -s.score * s.visible.sum()))


def _without_overlaps(sightings: list[ChartSighting]) -> list[ChartSighting]:
    """Remove overlapping sightings but the first; a side of one chart can match the opposite side of another."""
    kept: list[ChartSighting] = []
    for sighting in sightings:
        if not _overlaps(sighting.centre(), kept) and not any(_share_marks(sighting, s) for s in kept):
            kept.append(sighting)
    return kept


def _share_marks(sighting: ChartSighting, other: ChartSighting) -> bool:
    """Whether two sightings share x-corners, which two charts cannot."""
    a, b = sighting.corners[sighting.visible], other.corners[other.visible]
    near = np.linalg.norm(a[:, None] - b, axis=2) < other.widths().min() * BLOCK / CELLS / 4
    return bool(near.any())


def _overlaps(centre: Array, sightings: list[ChartSighting]) -> bool:
    """Whether a chart with this centre would overlap one of the sightings."""
    return any(np.linalg.norm(s.centre() - centre) < s.widths().min() / 2 for s in sightings)


def find_chart(image: npt.NDArray[np.floating]) -> ChartSighting:
    """Detect the one chart in a photograph.

    Raises Refused if there is none or more than one, or it is mirrored, negative, cut by the photograph's border,
    hidden at more than two marks, or its noise region is too small or too large.
    """
    sighting = one_chart(find_charts(image))
    check_usable(sighting, image.shape)
    return sighting


def one_chart(sightings: list[ChartSighting]) -> ChartSighting:
    """The only sighting. Raises Refused where there is none, or more than one."""
    if not sightings:
        raise Refused(
            "no chart in the photograph",
            "photograph the whole chart, in focus and evenly lit, with its noise region 45 to 300 pixels wide",
        )
    if len(sightings) > 1:
        places = ", ".join(f"({x:.0f}, {y:.0f})" for x, y in (s.centre() for s in sightings))
        raise Refused(
            f"one chart is required; got {len(sightings)}, centred at {places}", "cover or crop away the others"
        )
    return sightings[0]


def check_usable(sighting: ChartSighting, shape: tuple[int, ...]) -> None:
    """Raise Refused for a chart that the estimator cannot use; see `find_chart`."""
    if sighting.negative:
        raise Refused(
            "the photograph is a negative: the chart's white is dark", "invert the picture, or print the chart again"
        )
    if sighting.mirrored:
        raise Refused("the chart is mirrored", "flip the picture left to right, or photograph the chart directly")
    hidden = int(np.count_nonzero(~sighting.visible))
    half_block = sighting.widths().mean() * BLOCK / CELLS / 2
    cut = sighting.cut_marks(shape, half_block if hidden > MAX_HIDDEN else 0.0)
    if cut:
        raise Refused(
            f"the chart is cut off by the frame: {cut} of its 12 marks are not completely inside",
            "aim the camera so that the whole chart is in the frame",
        )
    if hidden > MAX_HIDDEN:
        raise Refused(
            f"at most {MAX_HIDDEN} of the chart's 12 marks may be hidden; {hidden} are",
            "remove what covers the chart, and avoid hard shadows and glare on it",
        )
    widths = sighting.widths()
    if widths.min() / TOLERANCE > MAX_WIDTH:
        raise Refused(
            f"the noise region must be at most {MAX_WIDTH:.0f} pixels wide; it is {widths.mean():.0f}",
            f"move back {widths.mean() / MAX_WIDTH:.1f}x or more, or print a smaller chart",
        )
