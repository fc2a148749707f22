"""The two verdicts in words: whether the measurement can be trusted, and whether what was measured meets its limits."""

from __future__ import annotations

MEASUREMENT = {
    "pass": "trusted",
    "doubtful": "doubtful",
    "refused": "refused",
    "unreadable": "unreadable",
    "lost": "lost",
    "fault": "fault",
}
"""Of the measurement; records keep the words on the left."""
SPECIFICATION = {
    "meets": "meets the specification",
    "undecided": "undecided against the specification",
    "does not meet": "does not meet the specification",
}
"""Of what was measured, against its specification."""


def measurement_words(verdict: str) -> str:
    """The measurement's verdict for people."""
    return MEASUREMENT.get(verdict, verdict)


def specification_words(verdict: str | None) -> str:
    """The specification's verdict for people; "" where there is none."""
    return SPECIFICATION.get(verdict or "", "")
