"""What a tour over the frame knows beside the chart: how many places, and from where it began."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from procedures.facts import gathered, number, required
from procedures.field.locations import Location
from procedures.pattern_psf.facts import SIZES, PatternFacts
from procedures.plan import Facts

TOUR = "tour_"
BASE = f"{TOUR}from_"
"""Before an axis' name: the fact where it was when the chart was in the middle."""


@dataclass(frozen=True)
class TourStart:
    """What the moves of a tour follow from: the chart seen where the tour began.

    Attributes
    ----------
    shape : rows and columns of the plane
    principal_px : distance of the image behind the lens, in its pixels
    distance_mm : of the chart along the optical axis
    seen_at : where in the frame
    half : half the width and height that the sheet takes of the frame, in parts of the frame's
    base : by name, where the axes were
    """

    shape: tuple[int, int]
    principal_px: float
    distance_mm: float
    seen_at: Location
    half: tuple[float, float]
    base: Mapping[str, float]


def start_of(facts: Facts) -> TourStart | None:
    """Where the tour began; None before it did. Raises BadParameter."""
    if f"{TOUR}rows" not in facts:
        return None
    rows, columns, principal_px, distance_mm, x, y, half_x, half_y = (
        number(facts, TOUR + name)
        for name in ("rows", "columns", "principal_px", "distance_mm", "x", "y", "half_x", "half_y")
    )
    base = {name.removeprefix(BASE): number(facts, name) for name in facts if name.startswith(BASE)}
    return TourStart(
        (int(rows), int(columns)), principal_px, distance_mm, Location(x, y), (half_x, half_y), base
    )  # fmt: skip


@dataclass(frozen=True)
class FieldFacts(PatternFacts):
    """The facts of the plan of a field: those of the chart, `places` to measure, and where the tour began."""

    places: float | None = None
    start: TourStart | None = gathered(start_of, *SIZES, prefix=TOUR)

    def begun(self) -> TourStart:
        """Where the tour began. Raises BadParameter before it did."""
        return required(self.start, "where the tour begins", "take the step `places` again")
