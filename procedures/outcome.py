"""Outcome of a procedure: numbers with their uncertainty, a verdict, or a refusal with reason and remedy."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import wraps
from typing import TYPE_CHECKING, Any, Generic, ParamSpec, Protocol, TypeVar

from procedures import display

if TYPE_CHECKING:
    from matplotlib.axes import Axes

T = TypeVar("T")
S = TypeVar("S")
P = ParamSpec("P")


class Verdict(StrEnum):
    """How far a result can be trusted."""

    PASS = "pass"
    DOUBTFUL = "doubtful"
    REFUSED = "refused"

    @property
    def rank(self) -> int:
        """0 for the best verdict."""
        return list(Verdict).index(self)


@dataclass(frozen=True)
class Cause:
    """A possible cause of a doubtful or refused result, with its remedy."""

    reason: str
    remedy: str


class WithVerdict(Protocol):
    """Interface of results with a verdict and its causes: of an outcome, a plane, a session."""

    @property
    def verdict(self) -> Verdict:
        """How far the result can be trusted."""

    @property
    def reason(self) -> str:
        """The most likely cause; empty for a pass."""

    @property
    def remedy(self) -> str:
        """Remedy of the cause."""

    @property
    def other_causes(self) -> tuple[Cause, ...]:
        """The less likely ones, by their evidence."""


@dataclass(frozen=True)
class Outcome(Generic[T]):
    """A value with its verdict; a refused outcome has no value.

    `reason` and `remedy` are the most likely cause of a verdict other than pass; `other_causes` follow.
    """

    value: T | None
    verdict: Verdict = Verdict.PASS
    reason: str = ""
    remedy: str = ""
    other_causes: tuple[Cause, ...] = ()

    def result(self) -> T:
        """The value, doubtful or not. Raises Refused with the most likely cause where there is none."""
        if self.value is None:
            raise Refused(self.reason, self.remedy)
        return self.value

    def __repr__(self) -> str:
        lines = [
            f"{type(self).__name__}: {self.verdict}",
            *(f"{one.reason}; {one.remedy}" for one in causes_of(self)[:1]),
        ]
        if self.value is not None:
            lines.append(display.summary(self.value, display.LINES - len(lines)))
        return "\n".join(lines)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the result as its `plot` does. Raises Refused without a result, TypeError without a figure of it."""
        plot = getattr(self.result(), "plot", None)
        if plot is None:
            raise TypeError(f"there is no figure of a {type(self.value).__name__}; plot its arrays")
        axes: Axes = plot(ax)
        return axes

    def _repr_html_(self) -> str | None:
        return display.html(self) if hasattr(self.value, "plot") else None

    def of_value(self, value: S | None) -> Outcome[S]:
        """The verdict and causes with another value."""
        return Outcome(value, self.verdict, self.reason, self.remedy, self.other_causes)


def checked_type(value: object, kind: type[T], remedy: str) -> T:
    """The value, if it is of that kind. Raises TypeError with what to pass instead."""
    if not isinstance(value, kind):
        raise TypeError(f"a {kind.__name__} is needed, got {type(value).__name__}: {remedy}")
    return value


@dataclass(frozen=True)
class Quantity:
    """A number that reaches a person: value, standard uncertainty, unit, method and number of samples."""

    value: float
    unit: str
    uncertainty: float
    method: str
    n: int


MOST_EVIDENCE = 100.0
SYMPTOM = 0.3  # prior of a check that many causes fail, relative to one that is specific to its cause


@dataclass(frozen=True)
class Check:
    """A statistic compared with its threshold: one line of a verdict.

    name : what is checked. Of the failed checks of one name only the first by severity and evidence is reported.
    statistic, threshold : the check fails where the statistic exceeds the threshold. A threshold of 0 marks a fact,
        true or false. Both are linear in the effect, so that ratios compare: standard deviations, not variances;
        standard uncertainties, not probabilities.
    severity : the verdict where the check fails
    least : the threshold is the least allowed: the check fails where the statistic lies below it
    given : what must hold as well for the check to apply
    prior : how likely the cause is before the statistic is known, relative to the other checks
    """

    name: str
    statistic: float
    threshold: float
    severity: Verdict
    sentence: str
    remedy: str
    least: bool = False
    given: bool = True
    prior: float = 1.0

    @property
    def fails(self) -> bool:
        """Whether the statistic lies beyond its threshold."""
        beyond = self.statistic < self.threshold if self.least else self.statistic > self.threshold
        return bool(self.given and beyond)

    @property
    def evidence(self) -> float:
        """Support of the cause where the check fails: the prior times the ratio of statistic and threshold.

        The ratio is at most `MOST_EVIDENCE`, and 1 for a fact.
        """
        if self.threshold == 0:
            return self.prior
        over, under = (self.threshold, self.statistic) if self.least else (self.statistic, self.threshold)
        return self.prior * (over / under if over < MOST_EVIDENCE * under else MOST_EVIDENCE)

    @property
    def cause(self) -> Cause:
        """The check as a possible cause of the verdict."""
        return Cause(self.sentence, self.remedy)


def verdict_of(checks: Iterable[Check], value: T | None = None) -> Outcome[T]:
    """The value with the worst verdict of the failed checks; their causes by severity, then by evidence."""
    failed = sorted((check for check in checks if check.fails), key=lambda one: (-one.severity.rank, -one.evidence))
    by_name: dict[str, Check] = {}
    for one in failed:
        by_name.setdefault(one.name, one)
    worst = failed[0].severity if failed else Verdict.PASS
    return _of_causes([one.cause for one in by_name.values()], worst, None if worst is Verdict.REFUSED else value)


def with_causes(outcome: Outcome[T], other: WithVerdict) -> Outcome[T]:
    """The outcome with the verdict and the causes of another one too: those of the worse verdict come first."""
    known, added = causes_of(outcome), causes_of(other)
    if other.verdict.rank > outcome.verdict.rank:
        return _of_causes(added + known, other.verdict, outcome.value)
    return _of_causes(known + added, outcome.verdict, outcome.value)


def mark_doubtful(outcome: Outcome[T], reason: str, remedy: str) -> Outcome[T]:
    """The outcome with one more flag, which comes first only where there is none."""
    return with_causes(outcome, Outcome(None, Verdict.DOUBTFUL, reason, remedy))


def worst_of(outcomes: Mapping[str, WithVerdict]) -> Outcome[Any]:
    """The worst verdict of several outcomes by name, without a value; the cause that most put first comes first. Causes
    with one remedy count as one."""
    worst = max((outcome.verdict for outcome in outcomes.values()), key=lambda one: one.rank)
    ranked = [[(name, cause) for cause in causes_of(one)] for name, one in outcomes.items() if one.verdict is worst]
    first = _by_remedy([pair for causes in ranked for pair in causes[:1]])
    others = _by_remedy([pair for causes in ranked for pair in causes[1:]])
    led = {one.remedy for one in first}
    return _of_causes([*first, *(other for other in others if other.remedy not in led)], worst, None)


def _by_remedy(named: Sequence[tuple[str, Cause]]) -> list[Cause]:
    """One cause for each remedy, those that most outcomes have first; its reason is that of the first of them."""
    groups: dict[str, dict[str, list[str]]] = {}
    for name, cause in named:
        groups.setdefault(cause.remedy, {}).setdefault(cause.reason, []).append(name)
    causes = []
    for remedy, reasons in sorted(groups.items(), key=lambda one: -sum(map(len, one[1].values()))):
        (reason, names), *more = reasons.items()
        likewise = ", ".join(name for _, others in more for name in others)
        causes.append(Cause(f"{', '.join(names)}: {reason}{f' (likewise {likewise})' if likewise else ''}", remedy))
    return causes


def causes_of(judged: WithVerdict) -> list[Cause]:
    """All causes, the most likely one first; none of a pass."""
    return [Cause(judged.reason, judged.remedy), *judged.other_causes] if judged.reason else []


def _of_causes(causes: Sequence[Cause], verdict: Verdict, value: T | None) -> Outcome[T]:
    first, *others = causes or [Cause("", "")]
    return Outcome(value, verdict, first.reason, first.remedy, tuple(others))


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

    def to_record(self) -> dict[str, str]:
        """The excluded item as an entry of a record."""
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


def with_refusal(estimate: Callable[P, Outcome[T]]) -> Callable[P, Outcome[T]]:
    """Decorate an estimate: its outcome is refused where it raises `Refused`."""

    @wraps(estimate)
    def outcome(*args: P.args, **kwargs: P.kwargs) -> Outcome[T]:
        try:
            return estimate(*args, **kwargs)
        except Refused as refusal:
            return Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)

    return outcome
