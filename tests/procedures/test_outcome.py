"""Verdicts of rules."""

from __future__ import annotations

from procedures.outcome import Rule, Verdict, verdict_of


def test_a_remedy_of_two_doubts_is_told_once() -> None:
    rules = [Rule(Verdict.DOUBTFUL, True, reason, remedy) for reason, remedy in (("a", "x"), ("b", "y"), ("c", "x"))]
    assert verdict_of(rules) == (Verdict.DOUBTFUL, "a; b; c", "x; y")
