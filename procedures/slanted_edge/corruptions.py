"""Corruptions of an edge: scores from the noise of its plains, the scatter along it, its profile, and their nuisances.

The noise of neighbouring pixels shows sharpening and smoothing; its growth with light, tone curves; its growth on the
edge, roughness, vibration and filters that spare edges. An edge spread function that falls shows negative light.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.clipping import step_of
from procedures.corruption.family import (
    NEGATIVE_LIGHT,
    SCATTER,
    SHARPENED,
    SMOOTHED,
    TONE_CURVE,
    VEIL,
    nuisance,
    threshold,
)
from procedures.corruption.noise import MaskScore, Variogram, mask_scores
from procedures.outcome import Check
from procedures.slanted_edge.edge_line import Course
from procedures.slanted_edge.profile import BINS, Profile, rebinned, steepness, values_of
from procedures.slanted_edge.strip import Strip
from procedures.slanted_edge.tail import MOST_TAIL
from procedures.slanted_edge.transfer import FREQUENCIES, STEP, mtf_of

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

MASK_RADII = (0.6, 1.0, 2.0)
"""Radii of the masks that are searched for in the noise, in pixels."""
MASK_PRIOR = {1.0: 0.05, 3.0: 0.03}
"""Prior amounts of unsharp masks by radius: a wider one shows more in the profile, so that less of it stays unseen."""
TONE_PRIOR = 0.12
"""Prior of the logarithm of a tone curve's exponent."""
SUBBINS = 16
"""Bins to a pixel within which samples scatter by noise alone, whatever the profile."""
MODEL_PX = 0.003
"""Displacement of an edge, root mean square, that the model's course and bins leave."""
WINDOWS_PX = (1, 2, 4, 8)
"""Lengths whose means are compared to see a falling spread function."""
MIN_SAMPLES = 20
"""Least number of samples in such a mean."""
REPEATED, REPEATED_AT = 0.005, 0.8
"""Aliases of four bins to a pixel: relative standard uncertainty of a frequency at 0.8 cycles/pixel, growing with the
fourth power of the frequency; from edges of known transfer functions."""


@dataclass(frozen=True)
class Evidence:
    """Scores of an edge.

    Attributes
    ----------
    masks : list of MaskScore
        Unsharp masks in the noise of the plains.
    growth : float
        Growth of the noise from dark to bright, in standard uncertainties; NaN where rounding hides it.
    scatter : float
        Excess of the scatter on the edge, in standard uncertainties.
    scatter_px : float
        Displacement, root mean square, that explains the excess; 0 where there is none.
    fall : float, windows : int
        Largest fall of the spread function between neighbouring windows, in standard uncertainties, and their number.
    tail : float
        Excess of the tail over that of any lens, in standard uncertainties.
    """

    masks: list[MaskScore]
    growth: float
    scatter: float
    scatter_px: float
    fall: float
    windows: int
    tail: float
    tail_sign: float


def examine(strip: Strip, course: Course, profile: Profile) -> Evidence:
    """Scores of a measured edge."""
    d = course.distances(strip)
    value = values_of(profile.light, strip, d)
    inside = strip.usable & (np.abs(d) < strip.reach_px)
    used = inside & (np.abs(d) < profile.end_px + 1)
    profile, residual = rebinned(profile, value, d, used)
    step = step_of(strip.samples[inside], strip.quantisation) / abs(profile.contrast)
    far = inside & (np.abs(d) > profile.flat_px)
    plain = np.where(far, value - (d > 0) + profile.tail / np.where(far, d, 1.0), 0.0)
    sides = [far & (d < 0), far & (d > 0)]
    variances = [float(np.var(plain[side])) for side in sides]
    noisy = min(variances) > (step / 2) ** 2
    fields = [Variogram.of(plain, side) for side in sides] if noisy else []
    counts = [np.count_nonzero(side) for side in sides]
    growth = np.log(variances[1] / variances[0]) / np.sqrt(2 / counts[0] + 2 / counts[1]) if noisy else np.nan
    scatter, scatter_px = _scatter(profile, residual, d, used, np.maximum(variances, (step / 2) ** 2))
    fall, windows = _fall(value, d, inside, variances)
    seen = profile.tail_seen
    return Evidence(
        mask_scores(fields, MASK_RADII), float(growth), scatter, scatter_px, fall, windows,
        (seen.px - MOST_TAIL) / max(seen.uncertainty_px, 1e-12), seen.px / max(seen.uncertainty_px, 1e-12),
    )  # fmt: skip


def _scatter(profile: Profile, residual: Array, d: Array, used: Mask, variances: Array) -> tuple[float, float]:
    """Score of the scatter on the edge against the noise between its plains, and the displacement that explains it.

    The variance of a linear sensor's noise is a convex function of the light: between the plains it is at most their
    mean by the light. A displacement adds the square of the profile's slope, a tone curve most in the middle.
    """
    core = used & (np.abs(d) < profile.flat_px)
    place = np.floor(d[core] * SUBBINS).astype(int)
    place -= place.min()
    n = np.bincount(place)
    counted = n > 1
    mean = np.bincount(place, residual[core]) / np.maximum(n, 1)
    square = np.bincount(place, (residual[core] - mean[place]) ** 2)[counted] / (n[counted] - 1)
    at = (np.bincount(place, d[core]) / np.maximum(n, 1))[counted]
    light = np.clip(np.interp(at, profile.centres, profile.esf), 0, 1)
    slope = steepness(profile, at) ** 2
    expected = variances[0] * (1 - light) + variances[1] * light + MODEL_PX**2 * slope
    weight = (n[counted] - 1) / (2 * expected**2)
    scores = [
        float(np.sum(weight * shape * (square - expected)) / np.sqrt(np.sum(weight * shape**2)))
        for shape in (slope, light * (1 - light))
    ]
    displacement = float(np.sum(weight * slope * (square - expected)) / np.sum(weight * slope**2))
    return max(scores), max(displacement, 0.0) ** 0.5


def _fall(value: Array, d: Array, inside: Mask, variances: list[float]) -> tuple[float, int]:
    """Largest fall of the spread function from a window to the next, in standard uncertainties; number of windows."""
    K = int(np.abs(d[inside]).max() * BINS) + 1
    bins = np.floor(d[inside] * BINS).astype(int) + K
    count = np.bincount(bins, minlength=2 * K).astype(np.float64)
    total = np.bincount(bins, value[inside], minlength=2 * K)
    noise = count * np.where(np.arange(2 * K) < K, *variances)
    sums = np.concatenate([np.zeros((3, 1)), np.cumsum([count, total, noise], axis=1)], axis=1)
    falls = []
    for width in WINDOWS_PX:
        k = width * BINS
        start = np.arange(0, 2 * K - 2 * k + 1, BINS if width > 1 else 2)
        first, second = (sums[:, start + (i + 1) * k] - sums[:, start + i * k] for i in (0, 1))
        known = (first[0] > MIN_SAMPLES) & (second[0] > MIN_SAMPLES)
        first, second = first[:, known], second[:, known]
        spread = np.sqrt(first[2] / first[0] ** 2 + second[2] / second[0] ** 2)
        falls.append((first[1] / first[0] - second[1] / second[0]) / np.maximum(spread, 1e-12))
    falls = np.concatenate(falls)
    return (float(falls.max()), len(falls)) if len(falls) else (0.0, 1)


def corruption_checks(evidence: Evidence, modes: dict[str, Array], noise: Array, raw: bool) -> list[Check]:
    """Tests of the corruptions that an edge shows."""
    sharp, soft = max(one.score for one in evidence.masks), max(-one.score for one in evidence.masks)
    places = len(MASK_RADII)
    fall = f"the edge goes beyond its plains by {evidence.fall:.1f} standard uncertainties"
    negative = f"the edge comes from beyond its plains by {-evidence.tail_sign:.1f} standard uncertainties"
    # scatter that moves the curve by less than its noise is in the budget
    moves = float(np.max(np.abs(modes.get(SCATTER.name, np.zeros(1))) / np.maximum(noise, 1e-12)))
    return [
        SHARPENED.check(sharp, raw=raw, places=places),
        SMOOTHED.check(soft, raw=raw, places=places),
        TONE_CURVE.check(-evidence.growth, raw=raw, given=bool(np.isfinite(evidence.growth))),
        SCATTER.check(evidence.scatter, f"{evidence.scatter:.1f} standard uncertainties", raw=raw, places=2),
        NEGATIVE_LIGHT.check(evidence.fall, fall, raw=raw, places=evidence.windows),
        NEGATIVE_LIGHT.check(-evidence.tail_sign, negative, raw=raw),
        VEIL.check(evidence.tail, raw=raw),
    ]


def modes_of(evidence: Evidence, profile: Profile, mtf: Array, *, raw: bool) -> dict[str, Array]:
    """Standard deviations of the curve (f,) by what the edge could not exclude, each with a sign that holds for all f."""
    slope = np.gradient(mtf, STEP)
    f = FREQUENCIES
    scatter = 1 - np.exp(-2 * (np.pi * f * evidence.scatter_px) ** 2)
    modes = {"bins": slope * f * REPEATED * (f / REPEATED_AT) ** 4, SCATTER.name: mtf * scatter}
    if raw:
        return modes
    by_radius = {one.radius_px: one for one in evidence.masks}
    for radius, prior in MASK_PRIOR.items():
        one = by_radius.get(radius, MaskScore(radius, 0.0, np.inf))
        amount = nuisance(one.amount, one.uncertainty, prior)
        modes[f"{SHARPENED.name} {radius:g} px"] = mtf * amount * (1 - np.exp(-2 * (np.pi * f * radius) ** 2))
    modes[TONE_CURVE.name] = TONE_PRIOR * _by_tone(profile, mtf)
    return modes


def _by_tone(profile: Profile, mtf: Array) -> Array:
    """Change of the curve (f,) by the logarithm of a tone curve's exponent."""
    change = 0.05
    dark, contrast = float(profile.light[0]), profile.contrast
    levels = np.maximum(dark + contrast * np.clip(profile.esf, 0, 1), 1e-3 * abs(contrast))
    curved = levels ** (1 + change)
    low, high = (max(level, 1e-3 * abs(contrast)) ** (1 + change) for level in (dark, dark + contrast))
    esf = (curved - low) / (high - low)
    tail = np.asarray(profile.tail)
    plain = mtf_of(np.clip(profile.esf, 0, 1), tail, profile.flat_px, profile.end_px)
    return np.asarray((mtf_of(esf, tail, profile.flat_px, profile.end_px) - plain) / change)
