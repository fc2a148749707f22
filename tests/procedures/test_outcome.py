"""Verdicts of checks, and which cause is shown first."""

import pytest

from procedures.outcome import SYMPTOM, Cause, Check, Outcome, Verdict, mark_doubtful, verdict_of, worst_of

DOUBTFUL, REFUSED = Verdict.DOUBTFUL, Verdict.REFUSED


def check(name: str, statistic: float, threshold: float = 1.0, severity: Verdict = DOUBTFUL, **more: object) -> Check:
    return Check(name, statistic, threshold, severity, f"{name} is bad", f"mend {name}", **more)  # type: ignore[arg-type]


def cause(name: str) -> Cause:
    return Cause(f"{name} is bad", f"mend {name}")


def shown(outcome: Outcome[object]) -> list[str]:
    """The names of the causes in the order in which they are shown."""
    return [one.removesuffix(" is bad") for one in (outcome.reason, *(other.reason for other in outcome.other_causes))]


def test_the_best_supported_cause_comes_first_and_checks_that_hold_make_none():
    outcome = verdict_of([check("light", 1.2), check("focus", 3.0)], 5)
    assert (outcome.value, outcome.verdict) == (5, DOUBTFUL)
    assert (outcome.reason, outcome.remedy) == ("focus is bad", "mend focus")
    assert outcome.other_causes == (cause("light"),)
    assert verdict_of([check("light", 1.0), check("focus", 0.9, least=True, given=False)], 5) == Outcome(5)


@pytest.mark.parametrize(
    ("one", "evidence"),
    [
        (check("above", 3.0, 2.0), 1.5),
        (check("below", 2.0, 3.0, least=True), 1.5),
        (check("below nothing", -1.0, 3.0, least=True), 100),
        (check("fact", True, 0), 1.0),
        (check("symptom", 3.0, 2.0, prior=SYMPTOM), 1.5 * SYMPTOM),
        (check("certain", float("inf"), 2.0), 100),
    ],
)
def test_evidence_is_the_distance_beyond_the_threshold_as_a_ratio_times_the_prior(one: Check, evidence: float) -> None:
    assert one.fails
    assert one.evidence == pytest.approx(evidence)


def test_causes_are_ranked_by_what_they_explain():
    assert shown(verdict_of([check("residual", 4.0, prior=SYMPTOM), check("tone curve", 2.0)])) == [
        "tone curve",
        "residual",
    ]
    outcome = verdict_of([check("light", 9.0), check("focus", 1.1, severity=REFUSED)], 5)
    assert (outcome.value, outcome.verdict) == (None, REFUSED)
    assert shown(outcome) == ["focus", "light"]
    outcome = verdict_of([check("light", 9.0), check("light", 9.0, 3.0, REFUSED), check("focus", 2.0)])
    assert shown(outcome) == ["light", "focus"]
    assert shown(mark_doubtful(Outcome(1), "flats is bad", "")) == ["flats"]
    added = mark_doubtful(verdict_of([check("light", 2.0), check("focus", 1.5)], 1), "flats is bad", "")
    assert shown(added) == ["light", "focus", "flats"]
    assert mark_doubtful(Outcome(None, REFUSED, "dark", ""), "flats", "").reason == "dark"


def test_of_several_planes_the_cause_that_most_of_them_have_comes_first() -> None:
    planes = {
        "R": Outcome(1, DOUBTFUL, "noise of 3", "expose longer", (Cause("b", "focus"),)),
        "G1": Outcome(1, DOUBTFUL, "12 % moved", "hold still", (Cause("a", "expose longer"), Cause("c", "print"))),
        "G2": Outcome(1, DOUBTFUL, "13 % moved", "hold still"),
        "B": Outcome(1),
    }
    whole = worst_of(planes)
    assert (whole.verdict, whole.reason, whole.remedy) == (DOUBTFUL, "G1: 12 % moved (likewise G2)", "hold still")
    assert whole.other_causes == (
        Cause("R: noise of 3", "expose longer"),
        Cause("R: b", "focus"),
        Cause("G1: c", "print"),
    )
    assert worst_of({"R": Outcome(1), "B": Outcome(1)}) == Outcome(None)
