"""Range of the focus bracket for a chart, check against the travel of the rail, and the widest feasible chart."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import cast

from procedures.facts import AxisTravel, facts_as, required
from procedures.outcome import BadParameter
from procedures.pattern_print.sheet import SMALLEST_WIDTH_MM
from procedures.pattern_psf.plan import check_sheets
from procedures.pattern_psf.pose import ImagingGeometry
from procedures.plan import Fact, Facts
from procedures.tilt.facts import TiltFacts
from procedures.tilt.plane import Positions, behind_lens_um

STEPS = (-3, -2, -1, 0, 1, 2, 3)
"""Range of the bracket in depths of focus behind the lens: f-number times a pixel of the plane."""
MARGIN_MM = 200.0
"""Margin at either end of the rail for a proposed chart: the rangefinder's zero is not the lens, and s/t has a
tolerance."""
BY_HAND = "take the bracket as your camera can, and give it to `station tilt` with a table of its positions"


def rail_of(known: TiltFacts) -> AxisTravel:
    """The rail. Raises BadParameter if the bench has none, or its travel is unknown."""
    rail = known.axes.get("z_mm")
    if rail is None or None in (rail.at, rail.low, rail.high):
        raise BadParameter("the bracket is made by a rail, the axis z_mm, which the bench has not", BY_HAND)
    return rail


def f_number_of(known: TiltFacts) -> float:
    """The f-number. Raises BadParameter if it is unknown."""
    return required(known.aperture, "the f-number", "give it in the step `rail`")


def bracket_mm(optics: ImagingGeometry, f_number: float, distance_mm: float) -> list[float]:
    """Distances of the chart at which its image steps through the sensor, the nearest first.

    Thin lens, focused at a distance: 1 / image + 1 / object = 1 / focal length.
    """
    f, depth_um = optics.focal_length_mm, f_number * optics.plane_pitch_um
    image_um = behind_lens_um(distance_mm, Positions.SET, f)
    images_mm = [(image_um - step * depth_um) / 1000 for step in STEPS]
    return sorted(f * image / (image - f) for image in images_mm)


# --- before the chart is printed ---------------------------------------------------------------------------------


def expected_bracket_mm(known: TiltFacts) -> list[float]:
    """The bracket of a chart at the target s/t of the guide."""
    optics = known.optics()
    return bracket_mm(optics, f_number_of(known), optics.distance_mm(known.wanted_px_per_cell))


def reach_mm(known: TiltFacts) -> tuple[float, float]:
    """Guaranteed smallest and largest distance between chart and lens.

    Where no rangefinder has measured the wall's distance, they are counted from an end of the rail.
    """
    rail = rail_of(known)
    at, low, high = (cast(float, one) for one in (rail.at, rail.low, rail.high))
    start = 0.0 if known.distance_mm is None else known.distance_mm - at
    return start + low + MARGIN_MM, start + high - MARGIN_MM


def reaches(known: TiltFacts, depths: Sequence[float]) -> bool:
    """Whether the rail reaches a bracket; without a rangefinder, whether it is long enough."""
    low, high = reach_mm(known)
    if known.distance_mm is None:
        return depths[-1] - depths[0] <= high - low
    return low <= depths[0] and depths[-1] <= high


def check_width(width: Fact, facts: Facts) -> None:
    """Raise BadParameter if a chart of this width needs a bracket beyond the rail, or too many sheets."""
    check_sheets(width, facts)
    known = facts_as(TiltFacts, {**facts, "chart_width_mm": width})
    depths, (low, high) = expected_bracket_mm(known), reach_mm(known)
    if not reaches(known, depths):
        reach = f"goes {high - low:.0f} mm" if known.distance_mm is None else f"reaches {low:.0f} to {high:.0f} mm"
        needed = f"{depths[0]:.0f} to {depths[-1]:.0f} mm"
        raise BadParameter(
            f"a chart {width:g} mm wide needs the lens {needed} before it; the rail {reach}",
            "print a chart of another width: a narrower one is photographed from nearer, and its bracket is shorter",
        )


def width_within_reach(facts: Facts) -> float:
    """Width in whole mm of the largest chart that fits one sheet and whose bracket fits the rail.

    Raises BadParameter if there is none.
    """
    known = replace(facts_as(TiltFacts, facts), chart_width_mm=None)
    for width in range(int(known.size.whole_mm), math.ceil(SMALLEST_WIDTH_MM) - 1, -1):
        if reaches(known, expected_bracket_mm(replace(known, chart_width_mm=float(width)))):
            return float(width)
    raise BadParameter(
        "no chart that can be printed has its bracket within the rail's reach",
        "hang it nearer to the rail or farther from it; a wider aperture or a longer lens shortens the bracket",
    )


# --- before the first photograph of the bracket ------------------------------------------------------------------


def off_reach_mm(known: TiltFacts, depths: Sequence[float]) -> float:
    """Required reduction of the distance between chart and rail; infinite if the rail is too short."""
    rail, start = rail_of(known), known.begun()
    at, low, high = (cast(float, one) for one in (rail.at, rail.low, rail.high))
    nearest, farthest = (at + depth - start.distance_mm for depth in (depths[0], depths[-1]))
    if farthest - nearest > high - low:
        return math.inf
    return max(low - nearest, 0.0) + min(high - farthest, 0.0)


def without_laser(facts: Facts) -> Facts:
    """The facts without the rangefinder's reading: the chart may be mounted anywhere."""
    return {name: one for name, one in facts.items() if name != "distance_mm"}
