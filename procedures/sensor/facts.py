"""Facts of a guided sensor measurement: the exposure, and the light of every picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from procedures.facts import CameraFacts, gathered_numbers

LIT = "lit_"  # prefix of a picture's mark (`mark_of`): the fact of its light, relative to the maximum
MARK = 16  # characters of a file's hash that identify it


def mark_of(sha256: str) -> str:
    """Name of a picture in the facts."""
    return sha256[:MARK]


@dataclass(frozen=True)
class SensorFacts(CameraFacts):
    """Facts of the plan.

    light_level : setting of the panel; None without one, where exposure times make the ladder
    ladder_s : exposure time of the whole ladder, or of its brightest level
    lit : light of every accepted picture, by its mark; 0 in the dark
    """

    light_level: float | None = None
    ladder_s: float | None = None
    lit: Mapping[str, float] = gathered_numbers(LIT)
