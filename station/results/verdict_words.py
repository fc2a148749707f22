"""The two verdicts in words: on the measurement, and on the lens against its limits."""

from __future__ import annotations

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
"""Verdicts against the specification."""


def measurement_words(verdict: str) -> str:
    """A verdict on the measurement."""
    return MEASUREMENT.get(verdict, verdict)


def specification_words(verdict: str | None) -> str:
    """A verdict against the specification; empty without one."""
    return SPECIFICATION.get(verdict or "", "")
