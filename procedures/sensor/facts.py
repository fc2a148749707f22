"""What a guided sensor measurement knows: the exposure, and with how much light every picture was taken."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from procedures.facts import CameraFacts, gathered, number
from procedures.plan import Facts

LIT = "lit_"
"""Before a picture's mark (`mark_of`): the fact how much light it had, over all there is."""
MARK = 16
"""Letters of a file's hash that tell it from the others."""


def mark_of(sha256: str) -> str:
    """What a picture is called in the facts."""
    return sha256[:MARK]


def light_of(facts: Facts) -> Mapping[str, float]:
    """The light of every picture, by its mark. Raises BadParameter."""
    return {name.removeprefix(LIT): number(facts, name) for name in facts if name.startswith(LIT)}


@dataclass(frozen=True)
class SensorFacts(CameraFacts):
    """The facts of the plan.

    Attributes
    ----------
    light_level : what the panel is set to; None where there is none: the ladder is of exposure times then
    ladder_s : the exposure time of the whole ladder, or of its brightest level
    lit : the light of every picture that counts, by its mark; 0 in the dark
    """

    light_level: float | None = None
    ladder_s: float | None = None
    lit: Mapping[str, float] = gathered(light_of, prefix=LIT)
