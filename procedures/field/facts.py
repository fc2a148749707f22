"""Facts of a tour over the frame, in addition to those of the chart: number of positions, and where it began."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from procedures.facts import gathered, number, required
from procedures.field.locations import Location
from procedures.pattern_psf.facts import SIZES, PatternFacts
from procedures.plan import Facts

TOUR = "tour_"
BASE = f"{TOUR}from_"  # prefix of an axis' name: the fact of its position when the chart was in the middle


@dataclass(frozen=True)
class TourStart:
    """The start of a tour, from which its moves are computed.

    shape : rows and columns of the plane
    principal_px : distance of the image from the lens, in pixels of the plane
    distance_mm : distance of the chart along the optical axis
    chart_at : position of the chart in the frame
    half : half the width and height of the sheet, in fractions of the frame's
    base : positions of the axes by name
    """

    shape: tuple[int, int]
    principal_px: float
    distance_mm: float
    chart_at: Location
    half: tuple[float, float]
    base: Mapping[str, float]


def start_of(facts: Facts) -> TourStart | None:
    """Start of the tour; None before it. Raises BadParameter."""
    if f"{TOUR}rows" not in facts:
        return None
    rows, columns, principal_px, distance_mm, x, y, half_x, half_y = (
        number(facts, TOUR + name)
        for name in ("rows", "columns", "principal_px", "distance_mm", "x", "y", "half_x", "half_y")
    )
    base = {name.removeprefix(BASE): number(facts, name) for name in facts if name.startswith(BASE)}
    return TourStart((int(rows), int(columns)), principal_px, distance_mm, Location(x, y), (half_x, half_y), base)


@dataclass(frozen=True)
class FieldFacts(PatternFacts):
    """Facts of the plan of a field: those of the chart, the number of `places`, and the start of the tour."""

    places: float | None = None
    start: TourStart | None = gathered(start_of, *SIZES, prefix=TOUR)

    def begun(self) -> TourStart:
        """Start of the tour. Raises BadParameter before it."""
        return required(self.start, "where the tour begins", "take the step `places` again")
