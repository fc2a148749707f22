"""The edge spread function: samples by their distance from the edge, light and tail fitted, four bins to a pixel.

A lens's spread function falls as 1/r^3, so its line spread function as 1/d^2 and the edge's approach to its plains as
1/d. That, and the light's slope, is fitted beyond the core: no window can hold the tail, and cut off it would raise
the whole MTF.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.ndimage import map_coordinates, spline_filter1d, uniform_filter1d

from procedures.slanted_edge.edge_line import Course
from procedures.slanted_edge.strip import Strip
from procedures.slanted_edge.tail import COLUMN, Lean, Tail, with_tail

Array = npt.NDArray[np.float64]

BINS = 4
"""Bins to a pixel: ISO 12233:2023."""
FLAT_WIDTHS, END_WIDTHS = 1.2, 2.6
"""Where the window begins to fall, and where it ends, in full widths at half maximum of the line spread function."""
ROUNDS = 4
"""In which values are moved to their bins' centres and averaged again."""
LEAST_FLAT_PX = 2.0
LEAST_FAR_PX = 3.0
"""Of the plains there is at least so much to fit them by."""
LIGHT_UNITS: Array = np.array([1, 1, 1, 1 / 20, 1 / 20, 1])
"""Of the plains' numbers: dark level, bright level, tail, relative slopes of the light across and along, per 20 pixels
so that all are of one size; the tail's lean."""


@dataclass(frozen=True)
class Profile:
    """The samples of an edge by bins, kept apart by row so that rows can be drawn anew.

    Attributes
    ----------
    sums, counts : (n, 2 K) float64
        Of each row the sum of its values in every bin, 0 dark and 1 bright, and their number. The bins' centres are
        at `centres`, and every value has been moved there along the spread function's own slope.
    light_normal : (n, 6, 6) float64, light_right : (n, 6) float64
        Each row's part of the normal equations of the plains.
    flat_px, end_px : float
        The window's.
    width_px : float
        Full width at half maximum of the line spread function, roughly.
    light : (6,) float64
        Dark and bright level, in samples of the plane; of the approach a/d to them, a times their difference; relative
        slopes per pixel, across and along the edge, taken out of the values; a g of the approach a/(d - g).
    noise : float
        Standard deviation of the samples about the profile, in samples of the plane.
    unevenness : float
        Of the plains beyond the window, without what differs between neighbours, in samples of the plane.
    tail_known : Tail or None
        What was known of a before, and `tail_weight`: of a row that says so in the plains' normal equations.
    lean : Lean
        What was known of a g before.
    samples : int
        Samples under the window.
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
    tail_known: Tail | None
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
    def tail_seen(self) -> Tail:
        """What the plains show of the tail by themselves, whatever is known."""
        normal, right = self.lean.added(self.light_normal.sum(axis=0), self.light_right.sum(axis=0))
        alone = solve_light(normal, right)
        spread = self.noise * float(np.sqrt(np.linalg.pinv(normal)[COLUMN, COLUMN]))
        return Tail(float(alone[COLUMN]) / self.contrast, spread / abs(self.contrast))

    @property
    def centres(self) -> Array:
        """The bins', in pixels from the edge, (2 K,)."""
        K = self.sums.shape[1] // 2
        return (np.arange(-K, K) + 0.5) / BINS

    @property
    def esf(self) -> Array:
        """The edge spread function, (2 K,)."""
        return filled(self.sums.sum(axis=0), self.counts.sum(axis=0))

    @property
    def overshoot(self) -> float:
        """By how much the edge goes beyond its plains for sure, over the contrast: no lens makes it, sharpening does.

        Of the mean of as many bins as a pixel has, less four standard deviations of its noise.
        """
        counts = self.counts.sum(axis=0)
        inside = np.abs(self.centres) < self.end_px
        mean = uniform_filter1d(self.esf, BINS)[inside]
        doubt = 4 * self.noise / abs(self.contrast) / np.sqrt(np.maximum(uniform_filter1d(counts, BINS) * BINS, 1))
        return float(max(np.max(np.maximum(mean - 1, -mean) - doubt[inside]), 0.0))

    @property
    def empty(self) -> float:
        """Share of the window's bins that no sample fell into."""
        inside = np.abs(self.centres) < self.end_px
        return float(np.mean(self.counts.sum(axis=0)[inside] == 0))


def filled(sums: Array, counts: Array) -> Array:
    """Means of bins (..., b), interpolated where there is nothing in them."""
    means = np.asarray(sums / np.where(counts > 0, counts, 1))
    known = np.reshape(counts > 0, (-1, counts.shape[-1])).all(axis=0)
    if known.all() or not known.any():
        return means
    place = np.arange(counts.shape[-1])
    rows = means.reshape(-1, counts.shape[-1])
    for row in rows:
        row[~known] = np.interp(place[~known], place[known], row[known])
    return rows.reshape(means.shape)


def edge_profile(strip: Strip, course: Course, widening: float = 1.0) -> Profile:
    """The spread function of an edge whose course is known, through a window so many times wider than usual."""
    d = course.distances(strip)
    inside = (np.abs(d) < strip.reach_px) & strip.usable
    reach = float(min(np.max(d[inside]), -np.min(d[inside])))
    width = _width(strip.samples[inside], d[inside], reach)
    flat = min(widening * max(FLAT_WIDTHS * width, LEAST_FLAT_PX), 0.5 * reach)
    end = min(widening * max(END_WIDTHS * width, 2 * LEAST_FLAT_PX), reach - 1)
    far = inside & (np.abs(d) > min((flat + end) / 2, reach - LEAST_FAR_PX))
    light, normal, right, weight, lean = _plains(strip, d, far, width)
    value = values_of(light, strip, d)
    used = inside & (np.abs(d) < end + 1)
    empty = np.zeros((len(value), 2 * (int(np.ceil(end * BINS)) + 1)))
    profile = Profile(
        *(empty, empty, normal, right, flat, end, width, light, 0.0, 0.0), strip.tail, weight, lean, int(used.sum())
    )
    profile, left = rebinned(profile, value, d, used)
    plain = value - (d > 0) + profile.tail / np.where(far, d, 1.0)
    return replace(
        profile,
        noise=float(np.std(left[used & (np.abs(d) < end)])) * abs(profile.contrast),
        unevenness=_unevenness(plain, far) * abs(profile.contrast),
    )


def values_of(light: Array, strip: Strip, d: Array) -> Array:
    """The samples without the light's slopes, 0 dark and 1 bright, (n, m)."""
    slope = 1 + light[3] * d + light[4] * strip.along[:, None]
    return np.asarray((strip.samples / slope - light[0]) / (light[1] - light[0]))


def rebinned(
    profile: Profile, value: Array, d: Array, used: npt.NDArray[np.bool_], rounds: int = ROUNDS
) -> tuple[Profile, Array]:
    """The profile of values at distances, and what is left of each value (n, m), which has no mean in any bin."""
    K = profile.sums.shape[1] // 2
    sums, counts = _binned(value, d, used, K)
    profile = replace(profile, sums=sums, counts=counts)
    for _ in range(rounds):
        moved = _moved(value, d, used, profile)
        sums, counts = _binned(moved, d, used, K)
        profile = replace(profile, sums=sums, counts=counts)
    bins = np.clip(np.floor(d * BINS).astype(int) + K, 0, 2 * K - 1)
    return profile, moved - profile.esf[bins]


def steepness(profile: Profile, d: Array) -> Array:
    """Slope of the edge spread function at distances, per pixel, of d's shape."""
    x = profile.centres
    return np.asarray(np.interp(d, (x[1:] + x[:-1]) / 2, np.diff(profile.esf) * BINS))


def _unevenness(left: Array, far: npt.NDArray[np.bool_]) -> float:
    """Standard deviation of what neighbours along the edge share: noise, which they do not, adds nothing."""
    both = far[1:] & far[:-1]
    shared = float(np.mean(left[1:][both] * left[:-1][both])) if both.any() else 0.0
    return float(np.sqrt(max(shared, 0.0)))


def _width(samples: Array, d: Array, reach: float) -> float:
    """Full width at half maximum of the line spread function, as a Gaussian's whose quarters lie as far apart."""
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
    # the quartiles of a Gaussian lie 1.349 standard deviations apart; the smoothing's 1.25 pixels add a little
    return 2.355 * float(np.sqrt(max((max(high - low, 0.0) / 1.349) ** 2 - 0.13, 0.02)))


def _last_below(x: Array, level: Array, share: float) -> float:
    """Where a rising curve is under a share for the last time before it stays above, in its inner half."""
    below = np.flatnonzero((level < share) & (np.abs(x) < 0.5 * x[-1]))
    if not len(below):
        return float(-0.5 * x[-1])
    i = below[-1]
    return float(x[i] + (share - level[i]) / max(level[i + 1] - level[i], 1e-9) * (x[i + 1] - x[i]))


def _plains(
    strip: Strip, d: Array, far: npt.NDArray[np.bool_], width_px: float
) -> tuple[Array, Array, Array, float, Lean]:
    """Levels, tail, light's slopes and the tail's lean (6,) by least squares over the samples beyond the core.

    With each row's part of the normal equations, and what is known of the tail: its weight in them, its lean.
    """
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
    """The plains' numbers (..., 6) of normal equations, held by a little where a narrow strip leaves them open."""
    weight = np.einsum("...ii->...", normal[..., :2, :2])[..., None, None]
    held = normal + 1e-9 * weight * np.eye(len(LIGHT_UNITS))
    return np.asarray(np.linalg.solve(held, right[..., None])[..., 0] * LIGHT_UNITS)


def _binned(value: Array, d: Array, used: npt.NDArray[np.bool_], K: int) -> tuple[Array, Array]:
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


def _moved(value: Array, d: Array, used: npt.NDArray[np.bool_], profile: Profile) -> Array:
    """Values moved along the spread function to their bins' centres: so that a bin's mean is a value, no average.

    Between the centres it is a cubic spline; what is not used is moved by nothing.
    """
    esf = profile.esf
    K = len(esf) // 2
    place = d[used] * BINS + K
    own = esf[np.clip(np.floor(place).astype(int), 0, 2 * K - 1)]
    moved = np.array(value)
    moved[used] += own - map_coordinates(
        spline_filter1d(esf, mode="nearest"), [place - 0.5], mode="nearest", prefilter=False
    )
    return moved
