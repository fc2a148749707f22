"""Scores of corruptions from one edge: noise of its plains, scatter on it, and light that is missing beside it.

The noise of neighbouring pixels shows sharpening and smoothing; its growth with light, tone curves; its growth on the
edge, roughness, vibration and filters that spare edges. An edge spread function that falls shows negative light.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from procedures.clipping import step_of
from procedures.corruption.directions import GHOST_PX
from procedures.corruption.family import Strength
from procedures.corruption.noise import MASK_RADII, Variogram, mask_scores, texture_correlation
from procedures.numerics.arrays import Array, Mask
from procedures.slanted_edge.edge_line import Course
from procedures.slanted_edge.profile import BINS, LIGHT_UNITS, EdgeProfile, filled, rebinned, steepness, values_of
from procedures.slanted_edge.strip import Strip
from procedures.slanted_edge.tail import MAX_TAIL
from procedures.slanted_edge.transfer import FREQUENCIES

HALO_PX, WIDE_PX = 3.0, 10.0
"""Radii of the unsharp masks that are searched for beside the edge: narrower ones hide in the edge, and far plains show
those of local contrast, of 15 to 30 pixels, alike."""
HALO_WIDTHS, HALO_FROM_PX = 1.5, 1.5
"""Least distance from the edge, in full widths at half maximum and in pixels, at which a lens's spread function has the
form of its tail; if there is more light than that, it looks like the opposite of a mask."""
SUBBINS = 16  # bins to a pixel within which samples scatter by noise alone, whatever the profile
MAX_GAIN = 0.01  # greatest spread of gains by pixels and paper, by which noise amid dark and bright is less than a mean
MIDTONES, MIN_GAIN = 12, 0.3
"""Exponent of 4 l (1 - l), l the light from 0 to 1, where a filter of local contrast that keeps edges changes from one
plain to the other: it compresses l = 0.4 to 0.6. Least gain there."""
MODEL_PX = 0.003  # displacement of an edge, root mean square, that the model's course and bins leave
DIFFERENCES = 35 / 9
"""Relative variance of the mean square of n second differences of white noise, times n: 2 for independent ones."""
SMOOTH_BINS = 13
"""Bins over which the plains' departure from their model is averaged: so many samples that their noise stays white."""
WINDOWS_PX = (1, 2, 4, 8)  # lengths whose means are compared to see a falling spread function
MIN_SAMPLES = 20  # least number of samples in such a mean
PERIODIC_FROM, LOBE, MTF_MODEL = 0.75, 0.15, 0.02
"""Frequency from which the MTF is searched for a rise, in cycles/pixel; rise behind a defocused pupil; model error."""


@dataclass(frozen=True)
class Evidence:
    """Scores of an edge; those of its noise are NaN or of infinite uncertainty where rounding hides it.

    masks : unsharp masks in the noise of the plains
    textured : the same, where the plains may have a fine texture, which the lens images
    halo, wide : unsharp masks of `HALO_PX` and `WIDE_PX` beside the edge
    scattered : an unsharp mask that sharpens the edge and spares the plains, by the scatter on the edge
    compressed : lack of contrast amid dark and bright, by the scatter there, as filters of local contrast leave it that
        keep edges
    growth, exponent : growth of the noise from dark to bright, in standard uncertainties; exponent of the light in its
        variance
    scatter, scatter_px : excess of the scatter on the edge, in standard uncertainties; the displacement that explains
        it, in pixels
    spared : lack of scatter on the edge, in standard uncertainties
    fall, windows : largest fall of the spread function to a neighbouring window, in standard uncertainties; number of
        windows
    tail : excess of the tail over that of any lens, in standard uncertainties
    period : excess of the MTF near one cycle per pixel over that of any lens, in standard uncertainties; `rise`, that
        MTF
    ghost : contrast across the edge of the plane mirrored through its centre, relative to the edge's
    """

    masks: list[Strength]
    textured: list[Strength]
    halo: Strength
    wide: Strength
    scattered: Strength
    compressed: Strength
    growth: float
    exponent: float
    scatter: float
    scatter_px: float
    spared: float
    fall: float
    windows: int
    tail: float
    period: float
    rise: float
    ghost: float
    mosaic: float = 0.0


@dataclass(frozen=True)
class _Samples:
    """Samples of an edge, 0 dark and 1 bright: distances, values, those of edge and plains, noise variances of both."""

    d: Array
    value: Array
    inside: Mask
    variances: tuple[float, float]


def examine(strip: Strip, course: Course, profile: EdgeProfile, mtf: Array, of_mtf: Array) -> Evidence:
    """Scores of a measured edge; `of_mtf` are the standard uncertainties of its MTF by noise."""
    d = course.distances(strip)
    value = values_of(profile.light, strip, d)
    inside = strip.usable & (np.abs(d) < strip.reach_px)
    rounding = (step_of(strip.samples[inside], strip.quantisation) / profile.contrast / 2) ** 2
    far = inside & (np.abs(d) > profile.flat_px)
    plain = _noise(value - (d > 0) + profile.tail / np.where(far, d, 1.0), d, far)
    sides = [far & (d < 0), far & (d > 0)]
    dark, bright = (float(np.var(plain[side])) for side in sides)
    fields, growth, exponent, inflation = [], math.nan, math.nan, [1.0, 1.0]
    if min(dark, bright) > rounding:
        fields = [Variogram.of(plain, side) for side in sides]
        inflation = [field.inflation(variance) for field, variance in zip(fields, (dark, bright), strict=True)]
        logarithm, uncertainty = _growth(plain, sides)
        growth = logarithm / uncertainty
        levels = np.maximum(profile.light[:2], 1e-3 * profile.contrast)
        if levels[1] > levels[0]:
            exponent = logarithm / math.log(levels[1] / levels[0])
    variances = max(dark, rounding), max(bright, rounding)
    samples = _Samples(d, value, inside, variances)
    averaged = replace(samples, variances=(variances[0] * inflation[0], variances[1] * inflation[1]))
    scatter, scatter_px, scattered, compressed, spared = _scatter(samples, profile)
    fall, windows = _fall(averaged, profile.slope_uncertainty * profile.light[:2] / profile.contrast)
    halo, wide = (_halo(averaged, profile, radius) for radius in (HALO_PX, WIDE_PX))
    tail = profile.tail_estimate
    excess = (mtf - np.minimum.accumulate(mtf) - LOBE) / np.maximum(of_mtf, MTF_MODEL)
    worst = int(np.argmax(np.where(FREQUENCIES < PERIODIC_FROM, -np.inf, excess)))
    return Evidence(
        masks=mask_scores(fields, MASK_RADII),
        textured=mask_scores(fields, MASK_RADII, [texture_correlation(FREQUENCIES, mtf)]),
        halo=halo,
        wide=wide,
        scattered=scattered if fields else Strength(),
        compressed=compressed if fields else Strength(),
        growth=growth,
        exponent=exponent,
        scatter=scatter,
        scatter_px=scatter_px,
        spared=spared if fields else math.nan,
        fall=fall,
        windows=windows,
        tail=(tail.px - MAX_TAIL) / max(tail.uncertainty_px, 1e-12),
        period=float(excess[worst]),
        rise=float(mtf[worst]),
        ghost=0.0 if strip.mirrored is None else _across(strip.mirrored, d, inside) / profile.contrast,
        mosaic=max((field.mosaic.score for field in fields), default=0.0),
    )


def _across(picture: Array, d: Array, inside: Mask) -> float:
    """Difference of a picture (n, m) between the two sides of the edge, near it."""
    sides = [inside & (d * side > GHOST_PX) & (d * side < 3 * GHOST_PX) for side in (1, -1)]
    bright, dark = (float(picture[side].mean()) if side.any() else 0.0 for side in sides)
    return bright - dark


def _growth(plain: Array, sides: list[Mask]) -> tuple[float, float]:
    """Logarithm of the ratio of bright to dark noise variance, with its standard uncertainty, by second differences
    along the edge: light that varies slowly there, as of another edge nearby, does not change them."""
    differences = plain[1:-1] - (plain[:-2] + plain[2:]) / 2
    known = [side[:-2] & side[1:-1] & side[2:] for side in sides]
    dark, bright = (float(np.mean(differences[side] ** 2)) + 1e-30 if side.any() else 1.0 for side in known)
    return math.log(bright / dark), math.sqrt(sum(DIFFERENCES / max(int(side.sum()), 1) for side in known))


def _noise(plain: Array, d: Array, far: Mask) -> Array:
    """Residual of the plains (n, m) from a smooth function of the distance, 0 outside of them."""
    bins = np.floor(d[far] * BINS).astype(int)
    bins -= bins.min()
    count, total = (uniform_filter1d(np.bincount(bins, part), SMOOTH_BINS) for part in (np.ones(len(bins)), plain[far]))
    noise = np.zeros_like(plain)
    noise[far] = plain[far] - (total / np.maximum(count, 1e-9))[bins]
    return noise


def _scatter(samples: _Samples, profile: EdgeProfile) -> tuple[float, float, Strength, Strength, float]:
    """Score of the scatter on the edge against its plains' noise, convex in the light, the displacement (the slope
    squared) and mask that explain it; lack of contrast by that amid dark and bright; score of less scatter than that,
    with pixels of unlike gain."""
    d = samples.d
    used = samples.inside & (np.abs(d) < profile.end_px + 1)
    profile, residual = rebinned(profile, samples.value, d, used)
    core = used & (np.abs(d) < profile.flat_px)
    place = np.floor(d[core] * SUBBINS).astype(int)
    place -= place.min()
    count = np.bincount(place)
    mean, at = (np.bincount(place, part[core]) / np.maximum(count, 1) for part in (residual, d))
    known = count > 1
    square = np.bincount(place, (residual[core] - mean[place]) ** 2)[known] / (count[known] - 1)
    light = np.clip(np.interp(at[known], profile.centres, profile.esf), 0, 1)
    slope, middle = steepness(profile, at[known]) ** 2, 4 * light * (1 - light)
    dark, bright = samples.variances
    between = dark * (1 - light) + bright * light
    expected = between + MODEL_PX**2 * slope
    convex = min(max(bright - dark, 0.0) / (1 + 2 * max(profile.light[0], 0.0) / profile.contrast), MAX_GAIN**2)
    least = between - convex * light * (1 - light)
    fits = []
    for shape, model in (
        (slope, expected),
        (middle, expected),
        (middle * expected, expected),
        (middle * least, least),
        (middle**MIDTONES * expected, expected),
    ):
        weight = (count[known] - 1) / (2 * model**2)
        information = max(float(np.sum(weight * shape**2)), 1e-300)
        fits.append((float(np.sum(weight * shape * (square - model))) / information, information**-0.5))
    score = max(strength / uncertainty for strength, uncertainty in fits[:2])
    spared = -fits[3][0] / fits[3][1]
    # a mask of amount a raises the variance of white noise by about 2 a
    strength, uncertainty = fits[2]
    scattered = Strength(strength / 2, uncertainty / 2)
    gain = max(1 + fits[4][0], MIN_GAIN**2) ** 0.5
    return score, max(fits[0][0], 0.0) ** 0.5, scattered, Strength(1 - gain, fits[4][1] / (2 * gain)), spared


def _binned(samples: _Samples) -> tuple[Array, Array, Array]:
    d = samples.d[samples.inside]
    K = int(np.abs(d).max() * BINS) + 1
    bins = np.floor(d * BINS).astype(int) + K
    count = np.bincount(bins, minlength=2 * K).astype(np.float64)
    total = np.bincount(bins, samples.value[samples.inside], minlength=2 * K).astype(np.float64)
    return (np.arange(-K, K) + 0.5) / BINS, total, count


def _fall(samples: _Samples, slopes: Array) -> tuple[float, int]:
    """Largest fall of the spread function from a window to the next, in standard uncertainties; number of windows.

    slopes : uncertainty of the light's slope per pixel, dark and bright
    """
    x, total, count = _binned(samples)
    noise = count * np.where(x < 0, *samples.variances)
    sums = np.concatenate([np.zeros((3, 1)), np.cumsum([count, total, noise], axis=1)], axis=1)
    scores = []
    for width in WINDOWS_PX:
        k = width * BINS
        start = np.arange(0, len(x) - 2 * k + 1, BINS if width > 1 else BINS // 2)
        first, second = (sums[:, start + (i + 1) * k] - sums[:, start + i * k] for i in (0, 1))
        known = np.minimum(first[0], second[0]) > MIN_SAMPLES
        first, second = first[:, known], second[:, known]
        by_light = k / BINS * np.where(x[start + k][known] < 0, slopes[0], slopes[1])
        variance = first[2] / first[0] ** 2 + second[2] / second[0] ** 2 + by_light**2
        scores.append((first[1] / first[0] - second[1] / second[0]) / np.sqrt(np.maximum(variance, 1e-24)))
    falls = np.concatenate(scores)
    return float(np.max(falls, initial=0.0)), max(len(falls), 1)


def _halo(samples: _Samples, profile: EdgeProfile, radius_px: float) -> Strength:
    """Unsharp mask beside the edge: light that is missing there, with levels, tail and slope of the light unknown."""
    x, total, count = _binned(samples)
    start = max(HALO_WIDTHS * profile.width_px, HALO_FROM_PX)
    kept = (np.abs(x) > start) & (count > 0)
    if np.count_nonzero(kept & (x < 0)) < BINS or np.count_nonzero(kept & (x > 0)) < BINS:
        return Strength()
    d, dark, bright = x[kept], *(profile.light[:2] / profile.contrast)
    base = np.where(d < 0, dark, bright)
    plains = np.column_stack([d < 0, d > 0, -1 / d, 1 / d**2, base * d * LIGHT_UNITS[3]])
    weight = np.sqrt(count[kept] / np.where(d < 0, *samples.variances))[:, None]
    values = filled(total, count)[kept] - (d > 0)
    # the mask is that of the edge and of its plains' model: their noise would look like a mask of itself
    reach = int(6 * radius_px * BINS)
    wide = x[0] - reach / BINS + np.arange(len(x) + 2 * reach) / BINS
    model = np.linalg.lstsq(plains * weight, values * weight[:, 0], rcond=None)[0]
    low, high, tail, lean = model[:4]
    far = np.where(wide < 0, low, 1 + high) - tail / wide + lean / wide**2
    esf = np.where(np.abs(wide) < start, np.interp(wide, profile.centres, profile.esf), far)
    mask = (esf - gaussian_filter1d(esf, radius_px * BINS))[reach:-reach]
    columns = np.column_stack([plains, mask[kept]])
    covariance = np.linalg.pinv((columns * weight).T @ (columns * weight))
    answer = covariance @ ((columns * weight).T @ (values * weight[:, 0]))
    return Strength(float(answer[-1]), float(np.sqrt(covariance[-1, -1])))
