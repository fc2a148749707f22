"""What is good enough: limits of a result's numbers, with guard bands as wide as the numbers are uncertain.

A number passes when even its uncertainty keeps it inside the limits, and fails when even its uncertainty does not
bring it inside: JCGM 106:2012, guarded acceptance and guarded rejection. Between the two it is doubtful.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from station.results.number_names import QUANTITIES, VALUES
from station.results.plane_result import PlaneResult

NUMBERS = (*QUANTITIES, *VALUES)
"""What a limit can be set for; values without an uncertainty have no guard band."""


ORDER = ("pass", "doubtful", "fail", "refused")
"""What can become of a plane by its estimate and its limits, the best first."""


class Compliance(StrEnum):
    """How a number stands to its limit, or a photograph to all of them; the best first."""

    PASS = "pass"
    DOUBTFUL = "doubtful"
    FAIL = "fail"


@dataclass(frozen=True)
class Limit:
    """The range in which a number must lie.

    Attributes
    ----------
    number : one of NUMBERS
    least, most : float
        Infinite where there is no such bound.
    coverage : float
        Standard uncertainties on either side of the number that must lie inside too.
    planes : sequence of str
        Where it holds; empty for every plane.
    """

    number: str
    least: float = -math.inf
    most: float = math.inf
    coverage: float = 2.0
    planes: Sequence[str] = ()


@dataclass(frozen=True)
class Judgement:
    """One number of one plane against its limit: the bounds and the value, None where there is none, and a sentence."""

    number: str
    judged: Compliance
    value: float | None
    uncertainty: float
    least: float | None
    most: float | None
    words: str


def verdict_within(record: PlaneResult, judged: Sequence[Judgement]) -> str:
    """The worst of the estimate's and the limits' verdicts, of ORDER."""
    return max([str(record.verdict), *(str(one.judged) for one in judged)], key=ORDER.index)


def all_against(record: PlaneResult, judged: Sequence[Judgement]) -> str:
    """All that speaks against a plane, in sentences: the estimate's reason, and the limits that are not met."""
    failed = [one.words for one in judged if one.judged is not Compliance.PASS]
    return "; ".join(words for words in (record.reason, *failed) if words)


def judge(record: PlaneResult, limits: Sequence[Limit]) -> tuple[Judgement, ...]:
    """The plane's numbers against the limits that hold for it; none where it was refused."""
    if not record.numbers:
        return ()
    return tuple(_judge(record, limit) for limit in limits if not limit.planes or record.name in limit.planes)


def _judge(record: PlaneResult, limit: Limit) -> Judgement:
    value, uncertainty = _number(record, limit.number)
    judged = _judged(value, limit.coverage * uncertainty, limit)
    least, most = (bound if math.isfinite(bound) else None for bound in (limit.least, limit.most))
    words = _words(limit, judged, value, uncertainty)
    return Judgement(limit.number, judged, value, uncertainty, least, most, words)


def _number(record: PlaneResult, name: str) -> tuple[float | None, float]:
    """A number of a plane with its standard uncertainty."""
    if name in record.numbers:
        quantity = record.numbers[name]
        return quantity.value, quantity.uncertainty
    plain = record.values.get(name)
    return (float(plain), 0.0) if isinstance(plain, int | float) else (None, 0.0)


def _judged(value: float | None, band: float, limit: Limit) -> Compliance:
    """NaN, of value or band, is inside nothing and outside nothing."""
    if value is None:
        return Compliance.DOUBTFUL
    if value - band >= limit.least and value + band <= limit.most:
        return Compliance.PASS
    if value + band < limit.least or value - band > limit.most:
        return Compliance.FAIL
    return Compliance.DOUBTFUL


def _words(limit: Limit, judged: Compliance, value: float | None, uncertainty: float) -> str:
    bounds = [f"{sign} {bound:g}" for sign, bound in (("≥", limit.least), ("≤", limit.most)) if math.isfinite(bound)]
    wanted = f"{limit.number} {' and '.join(bounds)}"
    if value is None:
        return f"the limit {wanted} cannot be judged: the PSF has no such number"
    got = f"{value:.4g} ± {uncertainty:.2g}" if uncertainty else f"{value:.4g}"
    if judged is Compliance.PASS:
        return f"{wanted} is met: {got}"
    if judged is Compliance.FAIL:
        return f"the limit {wanted} is missed: {got}"
    return f"the limit {wanted} is not surely met: {got} is within {limit.coverage:g} uncertainties of it"
