"""The MTF across slanted edges, start to end: a curve with its error bars, or a refusal.

References
----------
ISO 12233:2023, annex D (e-SFR): edge of polynomial course, Tukey window, four bins to a pixel. Beyond it: values are
moved to their bins' centres, light and tail are fitted, the window is as wide as the noise allows, and rows are drawn
anew for the uncertainty.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from procedures.display import axes_of, html, summary
from procedures.numbers import CYCLES, EDGE_ANGLE, EDGE_CROSSINGS, EDGE_MTF_NYQUIST, LEVELS
from procedures.outcome import Outcome, Quantity, Refused, Verdict, checked_type, verdict_of
from procedures.quality import Diffraction
from procedures.raw import Plane, PlaneLike, as_plane
from procedures.slanted_edge.edge_line import Course, find_course
from procedures.slanted_edge.find import EdgeSighting, edge_listed, find_edges
from procedures.slanted_edge.profile import Profile, edge_profile
from procedures.slanted_edge.refinement import refine_course
from procedures.slanted_edge.resampling import expected_noise, resampled_mtf
from procedures.slanted_edge.strip import EdgeLine, Roi, Strip, strip_of
from procedures.slanted_edge.tail import Tail
from procedures.slanted_edge.transfer import FREQUENCIES, frequency_at, mtf_of
from procedures.slanted_edge.trust import MOST_OVERSHOOT, check_clipping, check_course, check_samples, checks_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = npt.NDArray[np.float64]

WIDENINGS = (3.2, 1.8, 1.0)
"""Windows tried, the widest first."""
SURE = 0.008
"""Relative uncertainty of MTF50 up to which a wide window is worth its noise."""
REPEATED, REPEATED_AT = 0.005, 0.8
"""What four bins to a pixel repeat from above their limit: a standard uncertainty of half a per cent at 0.8 cycles per
pixel, growing with the fourth power of the frequency, as edges of known transfer functions show."""
MOST_FALL = 0.9
"""Share of the drawn curves that must fall to a level for its frequency to be told."""
METHOD = "ISO 12233:2023 e-SFR, four bins to a pixel; uncertainty by drawing rows anew"


def orientation(turned: bool) -> str:
    """Of an edge, in words; turned ones are nearer to horizontal."""
    return "near-horizontal" if turned else "near-vertical"


@dataclass(frozen=True)
class EdgeMtf:
    """The MTF across one edge.

    Attributes
    ----------
    roi : Roi
        Where it was measured.
    turned : bool
        Whether the edge is nearer to horizontal.
    frequencies, mtf, uncertainty : (n,) float64
        Cycles per pixel of the plane along the edge's normal, moduli, their standard uncertainties.
    numbers : mapping of str to Quantity
        mtf50, mtf30, mtf20, mtf10, mtf_nyquist, angle (from the nearest axis).
    normal_deg : float
        Direction of the normal, from x towards y, -90 to 90.
    order : int
        Of the polynomial along the edge.
    course : (n, 2) float64
        Points (x, y) of the plane along the edge.
    distances, esf : (m,) float64
        Edge spread function by distance in pixels, 0 dark and 1 bright.
    diagnostics : mapping of str to float
    """

    roi: Roi
    turned: bool
    frequencies: Array
    mtf: Array
    uncertainty: Array
    numbers: Mapping[str, Quantity]
    normal_deg: float
    order: int
    course: Array
    distances: Array
    esf: Array
    diagnostics: Mapping[str, float]

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
        """The edge's own: near-horizontal or near-vertical."""
        return orientation(self.turned)

    def at(self, frequency: float) -> Quantity | None:
        """The MTF at a frequency in cycles per pixel of the plane; None beyond the curve."""
        if not 0 <= frequency <= self.frequencies[-1]:
            return None
        value, spread = (float(np.interp(frequency, self.frequencies, one)) for one in (self.mtf, self.uncertainty))
        return Quantity(value, "1", spread, METHOD, self.numbers[EDGE_MTF_NYQUIST].n)


@dataclass(frozen=True, repr=False)
class EdgeOutcome(Outcome[EdgeMtf]):
    """One edge's MTF with its own verdict, and where it lies; no place where nothing was found."""

    roi: Roi | None = None
    turned: bool = False


def estimate_edges(plane: PlaneLike, diffraction: Diffraction | None = None) -> list[EdgeOutcome]:
    """Every slanted edge that a plane shows: those that pass, the doubtful, the refused, the best of each first.

    One refusal without a place where there is no edge. Diffraction, where it is known, says what is known of the tail.
    """
    plane = as_plane(plane)
    try:
        sightings = find_edges(plane.samples)
    except Refused as refusal:
        return [EdgeOutcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)]
    outcomes = [_of_sighting(one, plane, diffraction) for one in sightings]
    return sorted(outcomes, key=lambda one: list(Verdict).index(one.verdict))


def estimate_edge(plane: PlaneLike, roi: Roi, diffraction: Diffraction | None = None) -> EdgeOutcome:
    """The MTF across the one edge of a region, or the reason why it has none.

    A region that an edge has in `estimate_edges` means that edge, with as much of its plains as is plain.

    Raises
    ------
    BadParameter
        If the region does not lie in the plane.
    """
    plane = as_plane(plane)
    strip = strip_of(plane.samples, checked_type(roi, Roi, "pass Roi(x, y, width, height) in pixels of the plane"))
    listed = edge_listed(plane.samples, roi)
    if listed is not None:
        return _of_sighting(listed, plane, diffraction)
    return _placed(measure(_informed(strip, plane, diffraction)), strip)


def _of_sighting(sighting: EdgeSighting, plane: Plane, diffraction: Diffraction | None) -> EdgeOutcome:
    return _placed(measure(_informed(sighting.strip, plane, diffraction), sighting.line), sighting.strip)


def _informed(strip: Strip, plane: Plane, diffraction: Diffraction | None) -> Strip:
    """The strip with what is known of the camera."""
    tail = None if diffraction is None else Tail.of_pupil(diffraction)
    return replace(strip, quantisation=plane.quantisation, tail=tail, raw=plane.raw)


def _placed(outcome: Outcome[EdgeMtf], strip: Strip) -> EdgeOutcome:
    causes = outcome.reason, outcome.remedy, outcome.other_causes
    return EdgeOutcome(outcome.value, outcome.verdict, *causes, strip.roi, strip.turned)


def measure(strip: Strip, line: EdgeLine | None = None) -> Outcome[EdgeMtf]:
    """The MTF across the edge of a strip, near a line where one is known; refused outcomes have no value."""
    try:
        check_samples(strip)
        course = find_course(strip, line)
        check_clipping(strip, course)
        course = refine_course(strip, course)
        check_course(strip, course)
    except Refused as refusal:
        return Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)
    profile, mtf = _through_windows(strip, course)
    draws = resampled_mtf(profile)
    mtf50 = float(frequency_at(mtf, 0.5))
    uncertainty = float(np.nanstd(frequency_at(draws, 0.5))) if np.isfinite(mtf50) else np.inf
    outcome: Outcome[EdgeMtf] = verdict_of(checks_of(course, profile, mtf50, uncertainty, raw=strip.raw))
    return outcome.of_value(None if outcome.verdict is Verdict.REFUSED else _result(strip, course, profile, mtf, draws))


def _through_windows(strip: Strip, course: Course) -> tuple[Profile, Array]:
    """Profile and MTF through the widest window that the noise allows.

    A wide window holds most of what a lens throws far, a narrow one lets least noise through. Which it is depends on
    the noise alone, not on the answer: a choice by the answers made the error 1.4 times as large. The halo that
    sharpening leaves is no tail of a lens's form: it has to lie in the window.
    """
    end = np.inf
    for widening in WIDENINGS:
        profile = edge_profile(strip, course, widening)
        if profile.end_px > end / 1.2 and widening != WIDENINGS[-1]:
            continue
        end = profile.end_px
        mtf = mtf_of(profile.esf, np.asarray(profile.tail), profile.flat_px, profile.end_px)
        if expected_noise(profile, float(frequency_at(mtf, 0.5))) < SURE or profile.overshoot > MOST_OVERSHOOT:
            break
    return profile, mtf


def _result(strip: Strip, course: Course, profile: Profile, mtf: Array, draws: Array) -> EdgeMtf:
    slope = course.mean_slope
    tilt = float(np.degrees(np.arctan(slope)))
    # the normal of x = slope y is (1, -slope); turned, x and y change places
    normal = (90.0 - abs(tilt)) * (-1 if slope > 0 else 1) if strip.turned else -tilt
    return EdgeMtf(
        roi=strip.roi,
        turned=strip.turned,
        frequencies=FREQUENCIES,
        mtf=mtf,
        uncertainty=np.std(draws, axis=0),
        numbers=_numbers(strip, course, profile, mtf, draws),
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


def _points(strip: Strip, course: Course) -> Array:
    """The edge's course in the plane, (n, 2)."""
    across, along = course.at(strip.along), np.arange(len(strip.samples))
    x, y = (along, across) if strip.turned else (across, along)
    return np.column_stack([x + strip.roi.x, y + strip.roi.y])


def _numbers(strip: Strip, course: Course, profile: Profile, mtf: Array, draws: Array) -> dict[str, Quantity]:
    n = profile.samples
    numbers: dict[str, Quantity] = {}
    for level in LEVELS:
        value, drawn_at = float(frequency_at(mtf, level / 100)), frequency_at(draws, level / 100)
        if np.isfinite(value) and np.isfinite(drawn_at).mean() > MOST_FALL:
            drawn = float(np.nanstd(drawn_at))
            spread = math.hypot(drawn, REPEATED * value * (value / REPEATED_AT) ** 4)
            numbers[EDGE_CROSSINGS[level]] = Quantity(value, CYCLES, spread, METHOD, n)
    nyquist = int(np.searchsorted(FREQUENCIES, 0.5))
    numbers[EDGE_MTF_NYQUIST] = Quantity(float(mtf[nyquist]), "1", float(np.std(draws[:, nyquist])), METHOD, n)
    rows = len(strip.samples)
    angle = float(np.degrees(np.arctan(abs(course.mean_slope))))
    spread = float(np.degrees(course.slope_uncertainty / (1 + course.mean_slope**2)))
    numbers[EDGE_ANGLE] = Quantity(angle, "degree", spread, f"chord from end to end, order {course.order}", rows)
    return numbers
