"""Edge spread function: samples binned by their distance from the edge, four bins per pixel, with light and tail
fitted.

A PSF falls as 1/r^3, hence its line spread function as 1/d^2, and an edge approaches its plains as 1/d. This tail and
the slope of the light are fitted beyond the core, since no window contains the tail, and without it the MTF is too
high.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter1d, uniform_filter1d

from procedures.numerics.arrays import Array, Mask
from procedures.outcome import Refused
from procedures.slanted_edge.edge_line import NO_EDGE, Course
from procedures.slanted_edge.strip import Strip
from procedures.slanted_edge.tail import COLUMN, Lean, Tail, with_tail

BINS = 4  # bins per pixel, as in ISO 12233:2023
FLAT_WIDTHS, END_WIDTHS = 1.2, 2.6
"""Start and end of the window's taper, in full widths at half maximum of the line spread function."""
ROUNDS = 4  # iterations in which values are moved to the centres of their bins
MIN_FLAT_PX = 2.0
SLOPE = 3  # index of the slope across among the plains' parameters
MIN_FAR_PX = 3.0  # least width of the plains that they are fitted in
LIGHT_UNITS: Array = np.array([1, 1, 1, 1 / 20, 1 / 20, 1])
"""Units of the plains' parameters: dark level, bright level, tail, relative slopes of the light across and along, per
20 pixels so that all have one magnitude, and the tail's asymmetry."""


@dataclass(frozen=True)
class EdgeProfile:
    """The samples of an edge by bin and row, so that rows can be resampled.

    sums, counts : (n, 2 K) sum and number of each row's values in every bin, 0 dark and 1 bright, moved to the bins'
        `centres` along the spread function
    light_normal : (n, 6, 6) float64, light_right : (n, 6) float64; contribution of each row to the normal equations of
        the plains
    flat_px, end_px : start and end of the window's taper
    width_px : approximate full width at half maximum of the line spread function
    light : (6,) dark and bright level, in samples of the plane; a of the approach a/d times their difference; relative
        slopes per pixel across and along the edge, removed from the values; a g of the approach a/(d - g)
    noise : standard deviation of the samples about the profile, in samples of the plane
    unevenness : standard deviation of the plains beyond the window without that of white noise, in samples of the plane
    tail_prior : prior of a; `tail_weight` is its weight in the normal equations of the plains
    lean : prior of a g
    samples : samples under the window
    """

    sums: Array
    counts: Array
    light_normal: Array
    light_right: Array
    flat_px: float
    end_px: float
    width_px: float
    light: Array
    noise: float
    unevenness: float
    tail_prior: Tail | None
    tail_weight: float
    lean: Lean
    samples: int

    @property
    def contrast(self) -> float:
        """Bright less dark, in samples of the plane."""
        return float(self.light[1] - self.light[0])

    @property
    def tail(self) -> float:
        """a of the approach a/d to the plains, in pixels."""
        return float(self.light[2]) / self.contrast

    @property
    def tail_estimate(self) -> Tail:
        """Tail estimated from the plains alone, without its prior."""
        normal, right = self.lean.added(self.light_normal.sum(axis=0), self.light_right.sum(axis=0))
        spread = self.noise * float(np.sqrt(np.linalg.pinv(normal)[COLUMN, COLUMN]))
        return Tail(float(solve_light(normal, right)[COLUMN]) / self.contrast, spread / abs(self.contrast))

    @property
    def slope_uncertainty(self) -> float:
        """Standard uncertainty of the relative slope of the light across the edge, per pixel."""
        normal, _ = self.lean.added(self.light_normal.sum(axis=0), self.light_right.sum(axis=0))
        return self.noise * float(np.sqrt(np.linalg.pinv(normal)[SLOPE, SLOPE])) * float(LIGHT_UNITS[SLOPE])

    @property
    def centres(self) -> Array:
        """Centres of the bins, in pixels from the edge, (2 K,)."""
        K = self.sums.shape[1] // 2
        return (np.arange(-K, K) + 0.5) / BINS

    @property
    def esf(self) -> Array:
        """The edge spread function, (2 K,)."""
        return filled(self.sums.sum(axis=0), self.counts.sum(axis=0))

    @property
    def overshoot(self) -> float:
        """Significant excess of means over a pixel over the plains, relative to the contrast, less four standard
        deviations: a halo."""
        counts = self.counts.sum(axis=0)
        inside = np.abs(self.centres) < self.end_px
        mean = uniform_filter1d(self.esf, BINS)[inside]
        margin = 4 * self.noise / abs(self.contrast) / np.sqrt(np.maximum(uniform_filter1d(counts, BINS) * BINS, 1))
        return float(max(np.max(np.maximum(mean - 1, -mean) - margin[inside]), 0.0))

    @property
    def empty(self) -> float:
        """Share of the window's bins without a sample."""
        inside = np.abs(self.centres) < self.end_px
        return float(np.mean(self.counts.sum(axis=0)[inside] == 0))


def filled(sums: Array, counts: Array) -> Array:
    """Means of bins (..., b), interpolated where they are empty."""
    means = np.asarray(sums / np.where(counts > 0, counts, 1))
    known = np.reshape(counts > 0, (-1, counts.shape[-1])).all(axis=0)
    if known.all() or not known.any():
        return means
    place = np.arange(counts.shape[-1])
    rows = means.reshape(-1, counts.shape[-1])
    for row in rows:
        row[~known] = np.interp(place[~known], place[known], row[known])
    return rows.reshape(means.shape)


def edge_profile(strip: Strip, course: Course, widening: float = 1.0) -> EdgeProfile:
    """Spread function of an edge of known course, in a window widened by a factor."""
    d = course.distances(strip)
    inside = (np.abs(d) < strip.reach_px) & strip.usable
    reach = float(min(np.max(d[inside], initial=-np.inf), -np.min(d[inside], initial=np.inf)))
    if reach < MIN_FAR_PX:
        raise Refused("there is no edge in the region: the line through its gradients leaves it", NO_EDGE)
    width = _width(strip.samples[inside], d[inside], reach)
    flat = min(widening * max(FLAT_WIDTHS * width, MIN_FLAT_PX), 0.5 * reach)
    end = min(widening * max(END_WIDTHS * width, 2 * MIN_FLAT_PX), reach - 1)
    far = inside & (np.abs(d) > min((flat + end) / 2, reach - MIN_FAR_PX))
    light, normal, right, weight, lean = _plains(strip, d, far, width)
    if light[1] <= light[0]:
        raise Refused("there is no edge in the region: its sides have no levels of their own", NO_EDGE)
    value = values_of(light, strip, d)
    used = inside & (np.abs(d) < end + 1)
    empty = np.zeros((len(value), 2 * (int(np.ceil(end * BINS)) + 1)))
    profile = EdgeProfile(
        *(empty, empty, normal, right, flat, end, width, light, 0.0, 0.0), strip.tail, weight, lean, int(used.sum())
    )
    profile, residual = rebinned(profile, value, d, used)
    plain = value - (d > 0) + profile.tail / np.where(far, d, 1.0)
    # root of the covariance of neighbours along the edge, to which white noise contributes nothing
    both = far[1:] & far[:-1]
    shared = float(np.mean(plain[1:][both] * plain[:-1][both])) if both.any() else 0.0
    return replace(
        profile,
        noise=float(np.std(residual[used & (np.abs(d) < end)])) * abs(profile.contrast),
        unevenness=float(np.sqrt(max(shared, 0.0))) * abs(profile.contrast),
    )


def values_of(light: Array, strip: Strip, d: Array) -> Array:
    """Samples without the slopes of the light, 0 dark and 1 bright, (n, m)."""
    slope = 1 + light[3] * d + light[4] * strip.along[:, None]
    return np.asarray((strip.samples / slope - light[0]) / (light[1] - light[0]))


def rebinned(
    profile: EdgeProfile, value: Array, d: Array, used: Mask, rounds: int = ROUNDS
) -> tuple[EdgeProfile, Array]:
    """Profile of values at distances, and the residual of each value (n, m), whose mean in every bin is 0."""
    K = profile.sums.shape[1] // 2
    sums, counts = _binned(value, d, used, K)
    profile = replace(profile, sums=sums, counts=counts)
    for _ in range(rounds):
        moved = _moved(value, d, used, profile)
        sums, counts = _binned(moved, d, used, K)
        profile = replace(profile, sums=sums, counts=counts)
    bins = np.clip(np.floor(d * BINS).astype(int) + K, 0, 2 * K - 1)
    return profile, moved - profile.esf[bins]


def steepness(profile: EdgeProfile, d: Array) -> Array:
    """Slope of the edge spread function at distances d, per pixel."""
    x = profile.centres
    return np.asarray(np.interp(d, (x[1:] + x[:-1]) / 2, np.diff(profile.esf) * BINS))


def _width(samples: Array, d: Array, reach: float) -> float:
    """Full width at half maximum of the Gaussian with the line spread function's quartiles."""
    K = int(reach * BINS)
    bins = np.floor(d * BINS).astype(int) + K
    inside = (bins >= 0) & (bins < 2 * K)
    count = np.bincount(bins[inside], minlength=2 * K).astype(np.float64)
    esf = filled(np.bincount(bins[inside], samples[inside], minlength=2 * K).astype(np.float64), count)
    x = (np.arange(-K, K) + 0.5) / BINS
    dark, bright = np.median(esf[x < -0.5 * reach]), np.median(esf[x > 0.5 * reach])
    smooth = np.convolve(np.pad(esf, 2, mode="edge"), np.ones(5) / 5, mode="valid")
    level = (smooth - dark) / (bright - dark) if bright != dark else np.zeros_like(smooth)
    low, high = _last_below(x, level, 0.25), -_last_below(-x[::-1], 1 - level[::-1], 0.25)
    # the quartiles of a Gaussian are 1.349 standard deviations apart; the smoothing over 1.25 pixels adds 0.13
    return 2.355 * float(np.sqrt(max((max(high - low, 0.0) / 1.349) ** 2 - 0.13, 0.02)))


def _last_below(x: Array, level: Array, share: float) -> float:
    """Where a rising curve last crosses a level in its inner half."""
    below = np.flatnonzero((level < share) & (np.abs(x) < 0.5 * x[-1]))
    if not len(below):
        return float(-0.5 * x[-1])
    i = below[-1]
    return float(x[i] + (share - level[i]) / max(level[i + 1] - level[i], 1e-9) * (x[i + 1] - x[i]))


def _plains(strip: Strip, d: Array, far: Mask, width_px: float) -> tuple[Array, Array, Array, float, Lean]:
    """Parameters (6,) of the plains by least squares beyond the core, each row's normal equations, and the tail's
    priors."""
    bright = d > 0
    light = np.array([strip.samples[far & ~bright].mean(), strip.samples[far & bright].mean(), 0, 0, 0, 0.0])
    along = np.broadcast_to(strip.along[:, None], d.shape)
    approach = -1 / np.where(far, d, 1.0)
    weight, lean = 0.0, Lean()
    for _ in range(3):
        base = np.where(bright, light[1], light[0])
        slopes = base * d * LIGHT_UNITS[3], base * along * LIGHT_UNITS[4]
        columns = np.stack([~bright, bright, approach, *slopes, approach**2], axis=-1) * far[..., None]
        normal = np.einsum("nmi,nmj->nij", columns, columns)
        right = np.einsum("nmi,nm->ni", columns, strip.samples)
        total, answer, contrast = normal.sum(axis=0), right.sum(axis=0), light[1] - light[0]
        light = solve_light(*with_tail(*lean.added(total, answer), strip.tail, weight, contrast))
        variance = float(np.var((strip.samples - columns @ (light / LIGHT_UNITS))[far]))
        lean = Lean.of(float(light[COLUMN]), contrast, width_px, variance)
        if strip.tail is not None:
            weight = strip.tail.weight(variance / contrast**2, float(total[COLUMN, COLUMN]))
    return light, normal, right, weight, lean


def solve_light(normal: Array, right: Array) -> Array:
    """Parameters (..., 6) of the plains, slightly regularised as a narrow strip may not determine them."""
    weight = np.einsum("...ii->...", normal[..., :2, :2])[..., None, None]
    held = normal + 1e-9 * weight * np.eye(len(LIGHT_UNITS))
    return np.asarray(np.linalg.solve(held, right[..., None])[..., 0] * LIGHT_UNITS)


def _binned(value: Array, d: Array, used: Mask, K: int) -> tuple[Array, Array]:
    """Sums and numbers of the values in each row's bins, (n, 2 K)."""
    bins = np.floor(d * BINS).astype(int) + K
    inside = used & (bins >= 0) & (bins < 2 * K)
    n = len(value)
    flat = (np.arange(n)[:, None] * 2 * K + bins)[inside]
    sums, counts = (
        np.bincount(flat, weight, n * 2 * K).astype(np.float64).reshape(n, 2 * K)
        for weight in (value[inside], np.ones(len(flat)))
    )
    return sums, counts


def _moved(value: Array, d: Array, used: Mask, profile: EdgeProfile) -> Array:
    """Values moved along the spread function, a spline between the bins' centres, so that a mean is a value at the
    centre."""
    esf = profile.esf
    K = len(esf) // 2
    place = d[used] * BINS + K
    own = esf[np.clip(np.floor(place).astype(int), 0, 2 * K - 1)]
    moved = np.array(value)
    moved[used] += own - map_coordinates(
        spline_filter1d(esf, mode="nearest"), [place - 0.5], mode="nearest", prefilter=False
    )
    return moved
