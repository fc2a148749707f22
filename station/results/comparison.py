"""Comparison of numbers with their limits: each by itself, a plane's together, the worst of all."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

UNMEASURED = "it was not measured there"
"""Why a limit cannot be judged at a place: how such a judgement's sentence ends."""


class Compliance(StrEnum):
    """How a number stands to its limit, or a plane to its specification; the best first."""

    MEETS = "meets"
    UNDECIDED = "undecided"
    MISSES = "does not meet"


@dataclass(frozen=True)
class Judgement:
    """One number of one plane compared with its limit; bounds and value are None if there is none."""

    number: str
    judged: Compliance
    value: float | None
    uncertainty: float
    least: float | None
    most: float | None
    unit: str
    place: str
    words: str


@dataclass(frozen=True)
class Comparison:
    """A plane against its specification; judged : the worst of its limits, undecided if refused, None without one."""

    judged: Compliance | None = None
    judgements: tuple[Judgement, ...] = ()

    @property
    def in_short(self) -> tuple[Judgement, ...]:
        """The judgements, with all unmeasured places as one."""
        unseen = [judgement for judgement in self.judgements if judgement.words.endswith(UNMEASURED)]
        if len(unseen) < 2:
            return self.judgements
        places = ", ".join(dict.fromkeys(one.place for one in unseen))
        words = f"{len(unseen)} limits cannot be judged, for nothing was measured at {places}"
        together = Judgement("", Compliance.UNDECIDED, None, 0.0, None, None, "", "", words)
        return (*(judgement for judgement in self.judgements if judgement not in unseen), together)

    @property
    def against(self) -> tuple[str, ...]:
        """Sentences on the limits that are not met."""
        return tuple(one.words for one in self.in_short if one.judged is not Compliance.MEETS)

    def to_record(self) -> dict[str, Any]:
        """Entry of a plane in a record."""
        limits = [{key: getattr(judgement, name) for name, key in _ENTRIES.items()} for judgement in self.judgements]
        return {"verdict": self.judged and str(self.judged), "limits": limits}

    @classmethod
    def from_record(cls, entry: object) -> "Comparison | None":
        """The comparison in a record; None without a valid one."""
        try:
            limits = [{name: one[key] for name, key in _ENTRIES.items()} for one in entry["limits"]]  # type: ignore[index]
            judgements = tuple(Judgement(**{**limit, "judged": Compliance(limit["judged"])}) for limit in limits)
            judged = entry.get("verdict")  # type: ignore[attr-defined]
            return cls(Compliance(judged) if judged else None, judgements)
        except (AttributeError, KeyError, TypeError, ValueError):
            return None


_ENTRIES = {
    "number": "number", "judged": "verdict", "value": "value", "uncertainty": "uncertainty", "least": "min",
    "most": "max", "unit": "unit", "place": "place", "words": "words",
}  # fmt: skip


def worst(judged: Iterable[Compliance]) -> Compliance:
    """The worst of several."""
    return max(judged, key=list(Compliance).index)


MEASUREMENT = {
    "pass": "trusted",
    "doubtful": "doubtful",
    "refused": "refused",
    "unreadable": "unreadable",
    "lost": "lost",
    "fault": "fault",
}
"""Verdicts on the measurement; records have the words on the left."""
SPECIFICATION = {
    "meets": "meets the specification",
    "undecided": "undecided against the specification",
    "does not meet": "does not meet the specification",
}


def measurement_words(verdict: str) -> str:
    """A verdict on the measurement."""
    return MEASUREMENT.get(verdict, verdict)


def specification_words(verdict: str | None) -> str:
    """A verdict against the specification; empty without one."""
    return SPECIFICATION.get(verdict or "", "")
