"""Estimate of the MTF across slanted edges, with uncertainties and a verdict.

Source: ISO 12233:2023, annex D (e-SFR): edge of polynomial course, Tukey window, four bins per pixel. In
addition, values are moved to the centres of their bins, illumination and far tail are fitted, the window is as wide as
the noise allows, rows are resampled for the uncertainty, and corruptions of the photograph are tested.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from procedures.choice import Budget, combined
from procedures.corruption import probability
from procedures.corruption.directions import mirrored
from procedures.display import axes_of, html, summary
from procedures.numbers import CYCLES, EDGE_ANGLE, EDGE_CROSSINGS, EDGE_MTF50, EDGE_MTF_NYQUIST, LEVELS
from procedures.numerics.arrays import Array, Mask
from procedures.outcome import Outcome, Quantity, Refused, Verdict, checked_type, verdict_of
from procedures.quality import Diffraction
from procedures.raw import Plane, PlaneLike, as_plane
from procedures.slanted_edge.corruptions import corruption_checks, modes_of
from procedures.slanted_edge.edge_line import NO_EDGE, Course, find_course, tukey, without_defects
from procedures.slanted_edge.evidence import examine
from procedures.slanted_edge.find import EdgeSighting, edge_listed, find_edges
from procedures.slanted_edge.profile import (
    BINS,
    EdgeProfile,
    edge_profile,
    filled,
    rebinned,
    solve_light,
    steepness,
    values_of,
)
from procedures.slanted_edge.strip import EdgeLine, Roi, Strip, strip_of
from procedures.slanted_edge.tail import Tail, with_tail
from procedures.slanted_edge.transfer import FREQUENCIES, frequency_at, mtf_of, noise_gain
from procedures.slanted_edge.trust import MAX_OVERSHOOT, check_clipping, check_course, check_samples, checks_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDENINGS = (3.2, 1.8, 1.0)  # widths of the windows tried, relative to the narrowest
WIDE_UNCERTAINTY = 0.008  # relative uncertainty of MTF50 up to which a wide window is used
MIN_FALLEN = 0.9  # least share of the resampled curves that must fall to a level for its frequency to be reported
NYQUIST = int(np.searchsorted(FREQUENCIES, 0.5))
METHOD = "ISO 12233:2023 e-SFR, four bins per pixel; uncertainty by resampling rows"


def orientation(turned: bool) -> str:
    """Orientation of an edge in words; a turned edge is nearer to horizontal."""
    return "near-horizontal" if turned else "near-vertical"


@dataclass(frozen=True)
class EdgeMtf:
    """The MTF across one edge.

    roi : measured region
    turned : whether the edge is nearer to horizontal
    frequencies, mtf, uncertainty : (n,) cycles per pixel of the plane along the edge's normal, MTF, standard
        uncertainties
    numbers : mtf50, mtf30, mtf20, mtf10, mtf_nyquist, and the angle from the nearest axis
    budgets : terms of each number's uncertainty: the noise, the bins, and each corruption that could not be excluded
    normal_deg : direction of the normal from x towards y, -90 to 90
    order : degree of the polynomial course
    course : (n, 2) points (x, y) of the plane along the edge
    distances, esf : (m,) edge spread function over the distance in pixels, 0 dark and 1 bright
    probability : probability that MTF50 lies within two stated uncertainties: see `corruption.probability`
    """

    roi: Roi
    turned: bool
    frequencies: Array
    mtf: Array
    uncertainty: Array
    numbers: Mapping[str, Quantity]
    budgets: Mapping[str, Budget]
    normal_deg: float
    order: int
    course: Array
    distances: Array
    esf: Array
    diagnostics: Mapping[str, float]
    probability: float = float("nan")

    __repr__ = summary
    _repr_html_ = html

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the MTF with one standard uncertainty."""
        ax, f = axes_of(ax), self.frequencies
        (line,) = ax.plot(f, self.mtf, label=self.orientation)
        low, high = self.mtf - self.uncertainty, self.mtf + self.uncertainty
        ax.fill_between(f, low, high, color=line.get_color(), alpha=0.3, linewidth=0)
        ax.set(xlabel="frequency / (cycles/pixel)", ylabel="MTF", ylim=(0, max(1.05, float(self.mtf.max()))))
        ax.legend()
        return ax

    @property
    def orientation(self) -> str:
        """near-horizontal or near-vertical."""
        return orientation(self.turned)

    def at(self, frequency: float) -> Quantity | None:
        """The MTF at a frequency in cycles per pixel of the plane; None beyond the curve."""
        if not 0 <= frequency <= self.frequencies[-1]:
            return None
        value, spread = (float(np.interp(frequency, self.frequencies, one)) for one in (self.mtf, self.uncertainty))
        return Quantity(value, "1", spread, METHOD, self.numbers[EDGE_MTF_NYQUIST].n)


@dataclass(frozen=True, repr=False)
class EdgeOutcome(Outcome[EdgeMtf]):
    """One edge's MTF with its verdict and region; no region where there is no edge."""

    roi: Roi | None = None
    turned: bool = False


def estimate_edges(plane: PlaneLike, diffraction: Diffraction | None = None) -> list[EdgeOutcome]:
    """All slanted edges of a plane: passed, doubtful, refused, the best of each first; without one, a refusal without
    region."""
    plane = as_plane(plane)
    try:
        sightings = find_edges(plane.samples)
    except Refused as refusal:
        return [EdgeOutcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)]
    outcomes = [_measure_sighting(sighting, plane, diffraction) for sighting in sightings]
    return sorted(outcomes, key=lambda one: list(Verdict).index(one.verdict))


def estimate_edge(plane: PlaneLike, roi: Roi, diffraction: Diffraction | None = None) -> EdgeOutcome:
    """Measure the MTF across the edge of a region.

    The region of an edge of `estimate_edges` gives the same result as there.

    Raises BadParameter if the region does not lie in the plane.
    """
    plane = as_plane(plane)
    strip = strip_of(plane.samples, checked_type(roi, Roi, "pass Roi(x, y, width, height) in pixels of the plane"))
    listed = edge_listed(plane.samples, roi)
    if listed is not None:
        return _measure_sighting(listed, plane, diffraction)
    return _with_region(measure(_with_plane(strip, plane, diffraction)), strip)


def _measure_sighting(sighting: EdgeSighting, plane: Plane, diffraction: Diffraction | None) -> EdgeOutcome:
    return _with_region(measure(_with_plane(sighting.strip, plane, diffraction), sighting.line), sighting.strip)


def _with_plane(strip: Strip, plane: Plane, diffraction: Diffraction | None) -> Strip:
    """The strip with quantisation, tail, provenance and possible ghost of its plane."""
    tail, roi = None if diffraction is None else Tail.of_pupil(diffraction), strip.roi
    ghost = mirrored(plane.samples, (roi.x, roi.y), (roi.height, roi.width))
    ghost = ghost.T if strip.turned else ghost
    return replace(strip, quantisation=plane.quantisation, tail=tail, raw=plane.raw, mirrored=ghost)


def _with_region(outcome: Outcome[EdgeMtf], strip: Strip) -> EdgeOutcome:
    causes = outcome.reason, outcome.remedy, outcome.other_causes
    return EdgeOutcome(outcome.value, outcome.verdict, *causes, strip.roi, strip.turned)


def measure(strip: Strip, line: EdgeLine | None = None) -> Outcome[EdgeMtf]:
    """Measure the MTF across the edge of a strip, near a line where one is given; a refused outcome has no value."""
    try:
        check_samples(strip)
        course = find_course(strip, line)
        check_clipping(strip, course)
        strip = without_defects(strip, course)
        course = refine_course(strip, course)
        check_course(strip, course)
        profile, mtf = _through_windows(strip, course)
    except Refused as refusal:
        return Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)
    draws = resampled_mtf(profile)
    mtf50 = float(frequency_at(mtf, 0.5))
    uncertainty = float(np.nanstd(frequency_at(draws, 0.5))) if np.isfinite(mtf50) else np.inf
    evidence = examine(strip, course, profile, mtf, np.std(draws, axis=0))
    modes = modes_of(evidence, profile, mtf, raw=strip.raw)
    checks = [*checks_of(course, profile, mtf50, uncertainty), *corruption_checks(evidence, raw=strip.raw)]
    outcome: Outcome[EdgeMtf] = verdict_of(checks)
    if outcome.verdict is Verdict.REFUSED:
        return outcome.of_value(None)
    edge = _result(strip, course, profile, mtf, draws, modes)
    if (known := edge.numbers.get(EDGE_MTF50)) is not None:
        within = probability.within_two("edge", checks, known.uncertainty / known.value, raw=strip.raw)
        edge = replace(edge, probability=within)
    return outcome.of_value(edge)


def _through_windows(strip: Strip, course: Course) -> tuple[EdgeProfile, Array]:
    """Profile and MTF through the widest window that the noise allows.

    A wide window contains most of the far light, a narrow one passes less noise. The choice depends on the noise alone,
    since a choice by the results made the error 1.4 times as large; the halo of sharpening has no tail of a lens's form
    and must lie in the window.
    """
    end = np.inf
    for widening in WIDENINGS:
        profile = edge_profile(strip, course, widening)
        if profile.end_px > end / 1.2 and widening != WIDENINGS[-1]:
            continue
        end = profile.end_px
        mtf = mtf_of(profile.esf, np.asarray(profile.tail), profile.flat_px, profile.end_px)
        if (
            expected_noise(profile, float(frequency_at(mtf, 0.5))) < WIDE_UNCERTAINTY
            or profile.overshoot > MAX_OVERSHOOT
        ):
            break
    return profile, mtf


def _result(
    strip: Strip, course: Course, profile: EdgeProfile, mtf: Array, draws: Array, modes: Mapping[str, Array]
) -> EdgeMtf:
    slope = course.mean_slope
    tilt = float(np.degrees(np.arctan(slope)))
    # the normal of x = slope y is (1, -slope); turned, x and y change places
    normal = (90.0 - abs(tilt)) * (-1 if slope > 0 else 1) if strip.turned else -tilt
    numbers = _numbers(strip, course, profile, mtf, draws)
    budgets = {name: {"noise": number.uncertainty} | _by_modes(number, mtf, modes) for name, number in numbers.items()}
    return EdgeMtf(
        roi=strip.roi,
        turned=strip.turned,
        frequencies=FREQUENCIES,
        mtf=mtf,
        uncertainty=np.sqrt(_variance(mtf, draws) + sum(mode**2 for mode in modes.values())),
        numbers={name: replace(number, uncertainty=combined(budgets[name])) for name, number in numbers.items()},
        budgets=budgets,
        normal_deg=normal,
        order=course.order,
        course=_points(strip, course),
        distances=profile.centres,
        esf=profile.esf,
        diagnostics={
            "contrast": abs(profile.contrast),
            "noise": profile.noise,
            "unevenness": profile.unevenness,
            "empty_bins": profile.empty,
            "window_px": profile.end_px,
            "width_px": profile.width_px,
            "tail_px": profile.tail,
            "overshoot": profile.overshoot,
        },
    )


def _variance(mtf: Array, draws: Array) -> Array:
    """Mean square error (f,) of a modulus by noise, which also makes it too large where the MTF is near zero."""
    noise = np.var(draws, axis=0)
    power = np.maximum(np.mean(draws**2, axis=0) - mtf**2, noise)  # in phase with the OTF, and across it
    return np.asarray(noise + (power - noise) * np.minimum(power / np.maximum(mtf**2, 1e-12), 1.0))


def _by_modes(number: Quantity, mtf: Array, modes: Mapping[str, Array]) -> dict[str, float]:
    """Change of a number by one standard deviation of each mode of the curve."""
    if number.unit == "1":
        return {name: abs(float(mode[NYQUIST])) for name, mode in modes.items()}
    if number.unit != CYCLES:
        return {}
    slope = np.interp(number.value, FREQUENCIES, np.gradient(mtf, FREQUENCIES))
    return {name: abs(float(np.interp(number.value, FREQUENCIES, mode) / slope)) for name, mode in modes.items()}


def _points(strip: Strip, course: Course) -> Array:
    """Course of the edge in the plane, (n, 2)."""
    across, along = course.at(strip.along), np.arange(len(strip.samples))
    x, y = (along, across) if strip.turned else (across, along)
    return np.column_stack([x + strip.roi.x, y + strip.roi.y])


def _numbers(strip: Strip, course: Course, profile: EdgeProfile, mtf: Array, draws: Array) -> dict[str, Quantity]:
    n = profile.samples
    numbers: dict[str, Quantity] = {}
    for level in LEVELS:
        value, drawn_at = float(frequency_at(mtf, level / 100)), frequency_at(draws, level / 100)
        if np.isfinite(value) and np.isfinite(drawn_at).mean() > MIN_FALLEN:
            drawn = float(np.nanstd(drawn_at))
            numbers[EDGE_CROSSINGS[level]] = Quantity(value, CYCLES, drawn, METHOD, n)
    numbers[EDGE_MTF_NYQUIST] = Quantity(float(mtf[NYQUIST]), "1", float(np.std(draws[:, NYQUIST])), METHOD, n)
    rows = len(strip.samples)
    angle = float(np.degrees(np.arctan(abs(course.mean_slope))))
    spread = float(np.degrees(course.slope_uncertainty / (1 + course.mean_slope**2)))
    numbers[EDGE_ANGLE] = Quantity(angle, "degree", spread, f"chord from end to end, order {course.order}", rows)
    return numbers


# --- uncertainty of an MTF by the Bayesian bootstrap over rows ---
# The rows along the edge are samples of all that varies: noise, roughness, blur that changes along the edge. Random
# weights instead of repetitions leave no bin empty.

DRAWS = 300
SEED = 12233


def resampled_mtf(profile: EdgeProfile, draws: int = DRAWS) -> Array:
    """MTFs of resampled rows, (draws, f), which scatter about the profile's MTF as that does about the truth.

    Source: Rubin, The Bayesian bootstrap, Annals of Statistics 9, 1981. The variance of a mean of m rows
    with exponential weights is (m - 1) / (m + 1) of the true one; the spread is enlarged accordingly, and by
    `noise_gain`, as the values are not moved to the centres of their bins in each draw.
    """
    n = len(profile.sums)
    rng = np.random.default_rng(SEED)
    weight = rng.exponential(size=(draws, n))
    esf = filled(weight @ profile.sums, weight @ profile.counts)
    normal, right = (np.tensordot(weight, part, axes=1) for part in (profile.light_normal, profile.light_right))
    sureness = profile.tail_weight, profile.contrast
    normal, right = profile.lean.added(normal, right, rng.standard_normal(draws))
    light = solve_light(*with_tail(normal, right, profile.tail_prior, *sureness, rng.standard_normal(draws)))
    tail = light[:, 2] / (light[:, 1] - light[:, 0])
    # the values were divided by the slope of the light of all rows: that of the draw differs
    level = profile.esf + profile.light[0] / profile.contrast
    esf = esf - (light[:, 3:4] - profile.light[3]) * profile.centres * level
    drawn = mtf_of(esf, tail, profile.flat_px, profile.end_px)
    own = mtf_of(profile.esf, np.asarray(profile.tail), profile.flat_px, profile.end_px)
    m = max(float(np.mean(profile.counts.sum(axis=0)[profile.counts.sum(axis=0) > 0])), 2.0)
    return np.asarray(own + (drawn - own) * noise_gain() * np.sqrt((m + 1) / (m - 1)))


def expected_noise(profile: EdgeProfile, mtf50: float) -> float:
    """Relative uncertainty of MTF50 expected of this noise and window, NaN where MTF50 is: half the power of the bins'
    differences is in phase; d MTF / d log f is -0.65 there."""
    counts = profile.counts.sum(axis=0)
    bin_noise = profile.noise / abs(profile.contrast) / np.sqrt(max(float(counts[counts > 0].mean()), 1.0))
    window = float(np.linalg.norm(tukey(profile.centres, profile.flat_px, profile.end_px)))
    return float(2 * np.pi * mtf50 / BINS * bin_noise * window / (2**0.5 * 0.65))


# --- refinement of an edge's course ---
# Residuals of the mean spread function are regressed on the effect of a displacement of the edge, less what the spread
# function absorbs. Unlike the row centroids of ISO 12233:2023, the result does not depend on the edge's phase.

HIGHEST_ORDER = 5  # highest degree of the polynomial, as in ISO 12233:2023
MAX_ITERATIONS = 4
BINNINGS = 2  # rounds of binning in each iteration
CONVERGED_PX = 1e-4


def refine_course(strip: Strip, course: Course) -> Course:
    """Course of the degree with the least Bayesian information criterion; two degrees without a gain end the search."""
    profile = edge_profile(strip, course)
    best, least = _converged(strip, profile, _with_degree(course, 1))
    if np.isinf(least):
        raise Refused("there is no edge in the region: the line through its gradients leaves it", NO_EDGE)
    for order in range(2, HIGHEST_ORDER + 1):
        candidate, criterion = _converged(strip, profile, _with_degree(best, order))
        if criterion < least:
            best, least = candidate, criterion
        elif order > best.order + 1:
            break
    return best


def _with_degree(course: Course, order: int) -> Course:
    t = np.linspace(-1, 1, 50)
    return replace(course, coefficients=np.polyfit(t, course.at(t * course.half), order))


def _converged(strip: Strip, profile: EdgeProfile, course: Course) -> tuple[Course, float]:
    """Converged course of this degree, and its Bayesian information criterion, infinite where it left the strip."""
    for _ in range(MAX_ITERATIONS):
        d = course.distances(strip)
        used = strip.usable & (np.abs(d) < profile.end_px + 1)
        profile, residual = rebinned(profile, values_of(profile.light, strip, d), d, used, BINNINGS)
        core = used & (np.abs(d) < profile.flat_px)
        if not core.any():
            return course, np.inf
        change, covariance = _displacement(strip, profile, course, d, residual, core)
        course = replace(course, coefficients=course.coefficients + change)
        if np.abs(change).max() < CONVERGED_PX:
            break
    n, p = int(core.sum()), len(course.coefficients)
    square = float(np.sum(residual[core] ** 2)) + 1e-12
    # the chord's slope is that of the odd powers
    odd = np.arange(p)[::-1] % 2
    variance = float(odd @ covariance @ odd) * square / max(n - p, 1)
    course = replace(course, slope_uncertainty=max(variance, 0.0) ** 0.5 / course.half)
    return course, n * np.log(square) + p * np.log(n)


def _displacement(
    strip: Strip, profile: EdgeProfile, course: Course, d: Array, residual: Array, core: Mask
) -> tuple[Array, Array]:
    """Least-squares change of the coefficients (p,), and its covariance for unit noise (p, p)."""
    t = np.broadcast_to((strip.along / course.half)[:, None], d.shape)[core]
    normal = np.broadcast_to((1 / np.hypot(1, course.slope(strip.along)))[:, None], d.shape)[core]
    slope = -steepness(profile, d[core]) * normal * (1 if course.rising else -1)
    columns = slope[:, None] * np.vander(t, len(course.coefficients))
    bins = np.floor(d[core] * BINS).astype(int)
    bins -= bins.min()
    count = np.maximum(np.bincount(bins), 1)[:, None]
    means = np.stack([np.bincount(bins, column) for column in columns.T], axis=1) / count
    columns = columns - means[bins]
    scale = np.trace(columns.T @ columns)
    # the spread function absorbs the constant
    normal_matrix = columns.T @ columns + 1e-6 * scale * np.diag(
        np.arange(len(course.coefficients)) == len(columns[0]) - 1
    )
    covariance = np.linalg.pinv(normal_matrix, rcond=1e-8)
    return covariance @ (columns.T @ residual[core]), covariance
