"""Checks on an edge and its MTF, but those of corruptions."""

import numpy as np

from procedures.clipping import NOMINAL, find_clipping
from procedures.numerics.arrays import Array, Mask
from procedures.outcome import SYMPTOM, Check, Refused, Verdict
from procedures.slanted_edge.edge_line import NO_EDGE, Course
from procedures.slanted_edge.profile import EdgeProfile
from procedures.slanted_edge.strip import Strip
from procedures.slanted_edge.transfer import HIGHEST

MAX_CLIPPED = 0.01
MAX_OVERSHOOT = 0.01
OUTER = 0.6  # distance, relative to the plains' reach, from which their noise is estimated
MIN_ROWS = 16  # least length in pixels: fewer rows determine no uncertainty
MIN_DRIFT_PX = 0.9  # least drift across the pixels' grid: an edge must cross all phases
MAX_EMPTY = 0.05
FAINT, NOISY = 0.5, 2.0  # contrast over the noise of a pixel below which an edge is not visible, and not measurable


def check_samples(strip: Strip) -> None:
    """Raise Refused if more than 1 % of the samples are saturated, or the strip has too few rows."""
    clipped = float(np.mean(strip.samples >= NOMINAL))
    if clipped > MAX_CLIPPED:
        raise Refused(
            f"the edge's bright side must not be clipped; {clipped:.0%} of the region's samples are saturated",
            "expose less: white at 80 % of the scale is right",
        )
    if len(strip.samples) < MIN_ROWS:
        raise Refused(
            f"the edge is too short: it needs {MIN_ROWS} pixels along it or more, and has {len(strip.samples)}",
            "give a longer region, or photograph the edge from nearer",
        )


def check_clipping(strip: Strip, course: Course) -> None:
    """Raise Refused if more than 1 % of the samples accumulate at their largest or smallest value: a clipped side."""
    d = course.distances(strip)
    near = strip.usable & (np.abs(d) < strip.reach_px)
    reach = np.abs(d[near]).max()
    dark, bright = (_noise_along(strip.samples, near & (d * side > OUTER * reach)) for side in (-1, 1))
    samples = strip.samples[near]
    clipping = find_clipping(samples, strip.quantisation, dark_noise=dark, bright_noise=bright, of_edge=True)
    if clipping.white > MAX_CLIPPED:
        raise Refused(
            f"the edge's bright side must not be clipped; {clipping.white:.0%} of its samples are cut off at "
            f"{float(samples.max()):.3f} of the scale",
            f"expose less{'' if strip.raw else ', and take the RAW file'}: white at 80 % of the scale is right",
        )
    if clipping.black > MAX_CLIPPED:
        raise Refused(
            f"the edge's dark side must not be cut off; {clipping.black:.0%} of its samples lie at their smallest "
            f"value, {float(samples.min()):.3f} of the scale",
            "raise the black level (offset) of the camera"
            if strip.raw
            else "take the RAW file as the camera wrote it, and give its own black level",
        )


def _noise_along(samples: Array, plain: Mask) -> float:
    """Noise of a plain from second differences along the edge; 0 where there are none."""
    bends = np.diff(samples, 2, axis=0)[plain[2:] & plain[1:-1] & plain[:-2]]
    return float(np.sqrt(np.mean(bends**2) / 6)) if len(bends) else 0.0


def check_course(strip: Strip, course: Course) -> None:
    """Raise Refused if the edge is too near the pixels' axes for its length to cross all phases of the pixels."""
    n, slope = len(strip.samples), abs(course.mean_slope)
    if n * slope < MIN_DRIFT_PX:
        angle = float(np.degrees(np.arctan(slope)))
        short = angle > 2.0
        raise Refused(
            f"the edge must drift by {MIN_DRIFT_PX} pixel or more; over {n} pixels at {angle:.2f} degrees it drifts "
            f"by {n * slope:.2f}: it is too {'short' if short else 'near the axis'}",
            "give a longer region" if short else "turn the chart or the camera: 5 degrees from an axis are right",
        )


def checks_of(course: Course, profile: EdgeProfile, mtf50: float, uncertainty: float) -> list[Check]:
    """All checks on a measured edge but those of corruptions."""
    return _refusals(course, profile, mtf50, uncertainty) + _flags(profile, mtf50, uncertainty)


def _refusals(course: Course, profile: EdgeProfile, mtf50: float, uncertainty: float) -> list[Check]:
    refused = Verdict.REFUSED
    clear = abs(profile.contrast) / max(profile.noise, 1e-12)
    uneven = profile.unevenness / max(abs(profile.contrast), 1e-12)
    known = uncertainty / mtf50 if mtf50 > 0 and np.isfinite(uncertainty) else np.inf
    angle = float(np.degrees(np.arctan(abs(course.mean_slope))))
    near = "the diagonal" if angle > 35 else "the axis" if angle < 10 else "a simple ratio of whole pixels"
    noisy = (
        f"the edge is too noisy: its contrast is {clear:.1f} times a pixel's noise, and MTF50 uncertain by {known:.0%}"
    )
    return [
        Check("contrast", clear, FAINT, refused,
              f"there is no edge in the region: its sides differ by {clear:.2f} of a pixel's noise", NO_EDGE,
              least=True),
        Check("phases", profile.empty, MAX_EMPTY, refused,
              f"the edge must cross all phases of the pixels; at {angle:.1f} degrees it misses "
              f"{profile.empty:.0%} of them: it is too near {near}",
              "turn the chart or the camera: 5 degrees from an axis are right"),
        Check("resolution", bool(np.isnan(mtf50)), 0, refused,
              f"the MTF stays above 1/2 up to {HIGHEST:g} cycle/pixel, where an edge's ends",
              "measure the PSF with the chart, which resolves finer detail", given=clear >= NOISY),
        Check("noise", max(NOISY / max(clear, 1e-12), 0 if np.isnan(mtf50) else known / 0.2), 1.0, refused, noisy,
              "expose longer, or give a longer edge", given=clear >= FAINT),
        Check("evenness", uneven, 0.15, refused,
              f"there is no single edge in the region: the areas beside it vary by {uneven:.0%} of its contrast",
              NO_EDGE, given=clear >= FAINT),
    ]  # fmt: skip


def _flags(profile: EdgeProfile, mtf50: float, uncertainty: float) -> list[Check]:
    doubtful, known, estimate = Verdict.DOUBTFUL, profile.tail_prior, profile.tail_estimate
    uneven = profile.unevenness / max(abs(profile.contrast), 1e-12)
    return [
        Check("tail", 0.0 if known is None else known.contradiction(estimate), 1.0, doubtful,
              f"the edge approaches its plains as {estimate.px:.3f} ± {estimate.uncertainty_px:.3f} pixel over the "
              f"distance, and by the aperture it should as {known.px if known else 0:.3f}",
              "check aperture, pitch and wavelength of the photograph, and keep stray light away"),
        Check("uncertainty", uncertainty / max(mtf50, 1e-12), 0.05, doubtful,
              f"MTF50 has an uncertainty of {uncertainty / max(mtf50, 1e-12):.1%}",
              "expose longer, or give a longer edge",
              prior=SYMPTOM),
        Check("evenness", uneven, 0.03, doubtful, f"the areas beside the edge vary by {uneven:.1%} of its contrast",
              "light it evenly, and keep texture and reflections off it"),
        Check("plains", profile.end_px, 2.5 * profile.width_px, doubtful,
              f"the plain areas reach {profile.end_px:.1f} pixels, less than the edge's blur requires",
              "give a wider region", least=True),
    ]  # fmt: skip
