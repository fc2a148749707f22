"""Course of an edge: a polynomial through the centroids of each row's derivative, before refinement."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from procedures.numerics.arrays import Array, Mask
from procedures.outcome import Refused
from procedures.slanted_edge.strip import EdgeLine, Strip

CENTROID_ORDER = 2
"""Degree of the polynomial. Centroids depend on the edge's phase on the pixels, by hundredths of a pixel in a sharp
picture; over a short drift a higher degree would follow that wave."""
SMOOTHING_PX = 1.5  # standard deviation of the derivative filter that detects the edge
ROUNDS = 4
DEFECT, NEAR_PX, MOST_DEFECTS = 6.0, 6, 0.01
"""Standard deviations from its neighbours along the edge beyond which a pixel is defective; distance from the edge from
which the scatter no longer depends on it; share of the samples above which they are no defects."""
NO_EDGE = "give a region with one straight edge between two plain areas that crosses it from side to side"


@dataclass(frozen=True)
class Course:
    """An edge's course: x as a polynomial of the position along it.

    coefficients : (order + 1,) coefficients for t = position / half, highest power first, in pixels
    half : half length of the strip, in pixels
    rising : whether larger x is brighter
    slope_uncertainty : standard uncertainty of the chord's slope
    """

    coefficients: Array
    half: float
    rising: bool
    slope_uncertainty: float = np.inf

    @property
    def order(self) -> int:
        """Degree of the polynomial."""
        return len(self.coefficients) - 1

    def at(self, along: Array) -> Array:
        """x of the edge at positions along it."""
        return np.asarray(np.polyval(self.coefficients, along / self.half))

    def slope(self, along: Array) -> Array:
        """dx / d(along) at positions along it."""
        return np.asarray(np.polyval(np.polyder(self.coefficients), along / self.half) / self.half)

    @property
    def mean_slope(self) -> float:
        """Slope of the chord from end to end."""
        ends = self.at(np.array([-self.half, self.half]))
        return float((ends[1] - ends[0]) / (2 * self.half))

    def distances(self, strip: Strip) -> Array:
        """Distance of every sample from the edge along its normal, positive on the bright side, (n, m)."""
        along = strip.along
        x = np.arange(strip.samples.shape[1]) - self.at(along)[:, None]
        normal = 1 / np.hypot(1, self.slope(along))
        return np.asarray(x * normal[:, None] * (1 if self.rising else -1))


def find_course(strip: Strip, start: EdgeLine | None = None) -> Course:
    """The edge's course in a strip, near a given line: centroids of the windowed derivative, a polynomial, repeated
    (ISO 12233:2023, annex D). Raises Refused without an edge in it."""
    line, rising, reach = _first_line(strip, start)
    half = max((len(strip.samples) - 1) / 2, 1.0)
    course = Course(np.array([line.slope * half, line.middle]), half, rising)
    for _ in range(ROUNDS):
        course = _polynomial(strip.along, *_centroids(strip, course, reach), course)
    x = course.at(strip.along)
    outside = np.mean((x < 2) | (x > strip.samples.shape[1] - 3))
    if outside > 0:
        raise Refused(
            f"the edge must cross the region from side to side; it leaves it along {outside:.0%} of its length",
            "give a region that the edge crosses, with plain areas on both sides",
        )
    return course


def without_defects(strip: Strip, course: Course) -> Strip:
    """The strip without hot and dead pixels: samples that differ from the median of four neighbours along the edge by
    far more than others at their distance from it do."""
    n, usable = len(strip.samples), strip.usable
    padded = np.pad(strip.samples, ((2, 2), (0, 0)), mode="reflect")
    difference = np.abs(strip.samples - np.median([padded[i : i + n] for i in (0, 1, 3, 4)], axis=0))
    place = np.clip(np.rint(course.distances(strip)), -NEAR_PX, NEAR_PX).astype(int) + NEAR_PX
    groups = (difference[usable & (place == i)] for i in range(2 * NEAR_PX + 1))
    scatter = np.array([1.4826 * np.median(group) if len(group) else 0.0 for group in groups]) + strip.quantisation
    # near the sharpest edge, a ramp over one pixel, neighbours differ by half its step from row to row; at the ends,
    # where all lie on one side, by three times as much
    share = np.where(np.abs(strip.along) > n / 2 - 2, 1.5, 0.5)[:, None] * (np.abs(place - NEAR_PX) < NEAR_PX)
    ramp = share * abs(course.mean_slope) * np.ptp(strip.samples)
    defective = usable & (difference > DEFECT * scatter[place] + ramp)
    few = np.count_nonzero(defective) <= MOST_DEFECTS * np.count_nonzero(usable)
    return replace(strip, valid=usable & ~defective) if few else strip


def _first_line(strip: Strip, start: EdgeLine | None) -> tuple[EdgeLine, bool, float]:
    """Line along the strongest smoothed derivative, its sign, and the distance within which centroids are computed."""
    smooth = gaussian_filter1d(uniform_filter1d(strip.samples, 5, axis=0), SMOOTHING_PX, axis=1, order=1)
    x, along = np.arange(smooth.shape[1]), strip.along[:, None]
    rim = int(2 * SMOOTHING_PX)
    smooth[:, :rim] = smooth[:, -rim:] = 0
    near = np.ones(smooth.shape, dtype=bool)
    if start is not None:
        near = np.abs(x - start.middle - start.slope * along) < start.near_px
    total = np.sum(np.where(near, smooth, 0) ** 3)
    signed = smooth if total > 0 else -smooth
    strength = np.where(near, signed, 0)
    top = float(np.quantile(strength.max(axis=1), 0.5))
    if top <= 0:
        raise Refused("there is no edge in the region: it has one brightness", NO_EDGE)
    weight = np.maximum(strength - 0.3 * top, 0) ** 2
    line = start or _weighted_line(weight, x, along)
    reach = start.near_px if start else max(4.0, 0.15 * x.size)
    for _ in range(6):
        band = np.abs(x - line.middle - line.slope * along) < reach
        if not (weight * band).any():
            raise Refused("there is no edge in the region: no line fits its gradients", NO_EDGE)
        line = _weighted_line(weight * band, x, along)
    return line, bool(total > 0), _reach(strip, line)


def _weighted_line(weight: Array, x: Array, along: Array) -> EdgeLine:
    """Weighted least-squares line x = middle + slope along."""
    total = weight.sum()
    mean_x, mean_t = float((weight * x).sum() / total), float((weight * along).sum() / total)
    spread = float((weight * (along - mean_t) ** 2).sum())
    slope = float((weight * (along - mean_t) * (x - mean_x)).sum()) / spread if spread > 0 else 0.0
    return EdgeLine(mean_x - slope * mean_t, slope)


def _reach(strip: Strip, line: EdgeLine) -> float:
    """Half width of the centroids' window: twice the derivative's full width at half maximum, at least 4 pixels."""
    x = np.arange(strip.samples.shape[1]) - line.middle - line.slope * strip.along[:, None]
    inside = strip.usable & (np.abs(x) < strip.reach_px)
    bins = np.floor(2 * x[inside]).astype(int)
    bins -= bins.min()
    count = np.bincount(bins)
    profile = np.bincount(bins, strip.samples[inside]) / np.maximum(count, 1)
    steps = np.abs(np.diff(uniform_filter1d(profile, 3)))[:-1]
    wide = np.count_nonzero(steps > 0.5 * steps.max()) / 2
    return float(np.clip(2 * wide, 4, max(strip.samples.shape[1] / 3, 4)))


def _centroids(strip: Strip, course: Course, reach: float) -> tuple[Array, Mask]:
    """Centroid of each row's derivative under a Tukey window about the course, and whether the row has one."""
    expected = course.at(strip.along)[:, None]
    steps = np.diff(strip.samples, axis=1) * (1 if course.rising else -1)
    x = np.arange(steps.shape[1]) + 0.5
    weight = tukey(x - expected, reach / 2, reach) * steps
    total = weight.sum(axis=1)
    valid = (expected[:, 0] > 0) & (expected[:, 0] < strip.samples.shape[1] - 1) & (total > 0)
    typical = np.median(total[valid]) if valid.any() else 0.0
    valid &= total > 0.3 * typical
    return (weight * x).sum(axis=1) / np.where(valid, total, 1), valid


def tukey(x: Array, flat: float, end: float) -> Array:
    """Tapered cosine window: 1 up to |x| = flat, 0 from |x| = end."""
    share = np.clip((np.abs(x) - flat) / (end - flat), 0, 1)
    return np.asarray(0.5 + 0.5 * np.cos(np.pi * share))


def _polynomial(along: Array, centroid: Array, valid: Mask, course: Course) -> Course:
    """Polynomial through the centroids without outliers, its degree by the Bayesian information criterion."""
    if np.count_nonzero(valid) < CENTROID_ORDER + 3:
        raise Refused("there is no edge in the region: too few rows show one", NO_EDGE)
    t, x = along[valid] / course.half, centroid[valid]
    first = x - np.polyval(np.polyfit(t, x, CENTROID_ORDER), t)
    kept = np.abs(first) < 4 * 1.4826 * np.median(np.abs(first)) + 1e-3
    t, x = t[kept], x[kept]
    best, least = course, np.inf
    for order in range(1, CENTROID_ORDER + 1):
        coefficients = np.polyfit(t, x, order)
        square = float(np.sum((x - np.polyval(coefficients, t)) ** 2)) + 1e-12
        criterion = len(x) * np.log(square) + (order + 1) * np.log(len(x))
        if criterion < least:
            best, least = Course(coefficients, course.half, course.rising), criterion
    return best
