"""Facts of a guided tilt: the screws, the distance of each photograph of the bracket, and the required turns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from procedures.facts import gathered, gathered_numbers, number
from procedures.field.facts import FieldFacts
from procedures.plan import Facts
from procedures.tilt.screws import Screws

DEPTH, TURN = "depth_", "turn_"
"""Prefixes of a photograph's mark for the chart's distance, and of a screw's number for its turns."""


def turns_of(facts: Facts) -> tuple[float, ...]:
    """The required turns of the screws, away from the lens; empty before they are measured. Raises BadParameter."""
    screws = sorted(int(name.removeprefix(TURN)) for name in facts if name.startswith(TURN))
    return tuple(number(facts, f"{TURN}{i}") for i in screws)


@dataclass(frozen=True)
class TiltFacts(FieldFacts):
    """Facts of the plan.

    screw_count, screw_radius_mm, screw_pitch_mm, first_screw_deg : of `Screws`
    depths : distance of the chart along the optical axis in mm, by the photograph's mark
    turns : required turns of the screws
    helps : probability that they improve the alignment
    corner_um : height of the sensor's highest corner over its centre
    """

    screw_count: float | None = None
    screw_radius_mm: float | None = None
    screw_pitch_mm: float | None = None
    first_screw_deg: float | None = None
    depths: Mapping[str, float] = gathered_numbers(DEPTH)
    turns: tuple[float, ...] = gathered(turns_of, prefix=TURN)
    helps: float | None = None
    corner_um: float | None = None

    @property
    def screws(self) -> Screws:
        """The given screws, with defaults for unknown values."""
        given: dict[str, Any] = {
            "count": None if self.screw_count is None else int(self.screw_count),
            "radius_mm": self.screw_radius_mm,
            "pitch_mm": self.screw_pitch_mm,
            "first_deg": self.first_screw_deg,
        }
        return Screws(**{name: value for name, value in given.items() if value is not None})
