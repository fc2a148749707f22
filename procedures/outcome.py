"""What a procedure answers: numbers with their uncertainty, a verdict, or a refusal with reason and remedy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Generic, TypeVar

T = TypeVar("T")


class Verdict(StrEnum):
    """How far a result can be trusted."""

    PASS = "pass"
    DOUBTFUL = "doubtful"
    REFUSED = "refused"


@dataclass(frozen=True)
class Outcome(Generic[T]):
    """A value with the verdict on it; refused outcomes have no value, and say what to do."""

    value: T | None
    verdict: Verdict = Verdict.PASS
    reason: str = ""
    remedy: str = ""

    def result(self) -> T:
        """The value, doubtful or not. Raises Refused, which says why and what to do, where there is none."""
        if self.value is None:
            raise Refused(self.reason, self.remedy)
        return self.value


@dataclass(frozen=True)
class Quantity:
    """A number that reaches a person: value, standard uncertainty, unit, method and number of samples."""

    value: float
    unit: str
    uncertainty: float
    method: str
    n: int


@dataclass(frozen=True)
class Rule:
    """One line of the verdict: when it applies, what it then says, and what helps."""

    verdict: Verdict
    applies: bool
    reason: str
    remedy: str


def verdict_of(rules: Sequence[Rule]) -> tuple[Verdict, str, str]:
    """Verdict, reason and remedy of the rules that apply: the first refusal, else all doubts together."""
    refused = [rule for rule in rules if rule.applies and rule.verdict is Verdict.REFUSED]
    if refused:
        return Verdict.REFUSED, refused[0].reason, refused[0].remedy
    doubts = [rule for rule in rules if rule.applies]
    if doubts:
        remedies = dict.fromkeys(r.remedy for r in doubts)
        return Verdict.DOUBTFUL, "; ".join(r.reason for r in doubts), "; ".join(remedies)
    return Verdict.PASS, "", ""


@dataclass(frozen=True)
class Miss:
    """A photograph that gave nothing (plane and place empty), or a chart in it that gave nothing in a plane."""

    source: str
    reason: str
    remedy: str
    plane: str = ""
    place: str = ""

    def __str__(self) -> str:
        where = " ".join(part for part in (self.source, self.plane, self.place) if part)
        return self.reason if self.reason.startswith((f"{where}: ", f"{where} ")) else f"{where}: {self.reason}"

    def told(self) -> dict[str, str]:
        """As a record names what was left out."""
        return {"source": self.source, "reason": self.reason, "remedy": self.remedy}


class ProcedureError(Exception):
    """Work that cannot go on: what was required and what came (`reason`), and what to do about it (`remedy`)."""

    exit_code = 1

    def __init__(self, reason: str, remedy: str) -> None:
        super().__init__(f"{reason}; {remedy}" if remedy else reason)
        self.reason = reason
        self.remedy = remedy


class BadParameter(ProcedureError):
    """The parameters cannot be meant: even k, s = 1, an unknown plane, a folder that cannot be written."""

    exit_code = 2


class BadInput(ProcedureError):
    """The input is no data for this procedure: unreadable, truncated, no mosaic, sizes that differ."""

    exit_code = 4


class ColourInput(BadInput):
    """A picture in colours where one linear grey plane is read."""


class Refused(ProcedureError):
    """The data are readable, but a result from them could not be trusted."""

    exit_code = 5
