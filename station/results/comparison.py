"""How numbers stand to their limits: each by itself, a plane's together, the worst of all."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

UNMEASURED = "it was not measured there"
"""Why a limit cannot be judged at a place: how such a judgement's sentence ends."""


class Judged(StrEnum):
    """How a number stands to its limit, or a plane to its specification; the best first."""

    MEETS = "meets"
    UNDECIDED = "undecided"
    MISSES = "does not meet"


@dataclass(frozen=True)
class Judgement:
    """One number of one plane against its limit: the bounds and the value, None where there is none, and a sentence."""

    number: str
    judged: Judged
    value: float | None
    uncertainty: float
    least: float | None
    most: float | None
    unit: str
    place: str
    words: str


@dataclass(frozen=True)
class Comparison:
    """A plane against its specification.

    Attributes
    ----------
    judged : Judged or None
        The worst of its limits; undecided where the plane was refused; None where no limit holds for it.
    """

    judged: Judged | None = None
    judgements: tuple[Judgement, ...] = ()

    @property
    def in_short(self) -> tuple[Judgement, ...]:
        """The judgements, all of what was not measured as one: limits at every place are many."""
        unseen = [one for one in self.judgements if one.words.endswith(UNMEASURED)]
        if len(unseen) < 2:
            return self.judgements
        places = ", ".join(dict.fromkeys(one.place for one in unseen))
        words = f"{len(unseen)} limits cannot be judged, for nothing was measured at {places}"
        together = Judgement("", Judged.UNDECIDED, None, 0.0, None, None, "", "", words)
        return (*(one for one in self.judgements if one not in unseen), together)

    @property
    def against(self) -> tuple[str, ...]:
        """What is not met, in sentences."""
        return tuple(one.words for one in self.in_short if one.judged is not Judged.MEETS)

    def told(self) -> dict[str, Any]:
        """As a record tells it."""
        return {"verdict": self.judged and str(self.judged), "limits": [_told(one) for one in self.judgements]}


def _told(one: Judgement) -> dict[str, Any]:
    return {
        "number": one.number, "verdict": str(one.judged), "value": one.value, "uncertainty": one.uncertainty,
        "min": one.least, "max": one.most, "unit": one.unit, "place": one.place, "words": one.words,
    }  # fmt: skip


def worst(judged: Iterable[Judged]) -> Judged:
    """The worst of several."""
    return max(judged, key=list(Judged).index)
