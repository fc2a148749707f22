"""What a guided tilt knows: the screws, where each photograph of the bracket was taken, and how to turn what."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from procedures.facts import gathered, number
from procedures.field.facts import FieldFacts
from procedures.plan import Facts
from procedures.tilt.screws import Screws

DEPTH, TURN = "depth_", "turn_"
"""Before a photograph's mark: the fact at which distance the chart stood; before a screw's number: its turns."""


def depths_of(facts: Facts) -> Mapping[str, float]:
    """Distance of the chart along the optical axis in mm, by the photograph's mark. Raises BadParameter."""
    return {name.removeprefix(DEPTH): number(facts, name) for name in facts if name.startswith(DEPTH)}


def turns_of(facts: Facts) -> tuple[float, ...]:
    """The turns of the screws, away from the lens, as they were found to be needed; none before that."""
    told = sorted(int(name.removeprefix(TURN)) for name in facts if name.startswith(TURN))
    return tuple(number(facts, f"{TURN}{i}") for i in told)


@dataclass(frozen=True)
class TiltFacts(FieldFacts):
    """The facts of the plan.

    Attributes
    ----------
    screw_count, screw_radius_mm, screw_pitch_mm, first_screw_deg : of `Screws`
    depths : distance of the chart in mm, by the photograph's mark
    turns : of the screws, as they were found to be needed
    helps : probability that they help
    corner_um : the sensor's highest corner over its centre
    """

    screw_count: float | None = None
    screw_radius_mm: float | None = None
    screw_pitch_mm: float | None = None
    first_screw_deg: float | None = None
    depths: Mapping[str, float] = gathered(depths_of, prefix=DEPTH)
    turns: tuple[float, ...] = gathered(turns_of, prefix=TURN)
    helps: float | None = None
    corner_um: float | None = None

    @property
    def screws(self) -> Screws:
        """As they were told; the usual ones where they were not."""
        usual = Screws()
        return Screws(
            usual.count if self.screw_count is None else int(self.screw_count),
            usual.radius_mm if self.screw_radius_mm is None else self.screw_radius_mm,
            usual.pitch_mm if self.screw_pitch_mm is None else self.screw_pitch_mm,
            usual.first_deg if self.first_screw_deg is None else self.first_screw_deg,
        )
