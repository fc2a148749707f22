"""The uncertainty of a number taken apart: what each source adds to it, as a calibration laboratory is audited on.

Every term is a standard uncertainty in the number's own unit; they are independent, and the root of the sum of their
squares is the number's. Source: ISO/IEC Guide 98-3 (GUM), section 5.1 and annex H.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from procedures.mtf_numbers import LEVELS
from procedures.quality import Quality

Budget = Mapping[str, float]
"""Terms by name, each a standard uncertainty."""

TERMS = {
    "noise": "noise of the samples",
    "light": "light and response",
    "sensor": "the sensor's response, as calibrated",
    "geometry": "geometry",
    "print": "printed edges",
    "tail": "energy outside the support",
    "mismatch": "what the model leaves over",
    "focus": "focus at either distance",
    "choice": "choice of s and k",
}
"""What the terms are, in the order in which they are told."""
FREQUENCIES = tuple(f"mtf{level}_" for level in LEVELS)
"""How the names of numbers begin that are frequencies."""


def combined(budget: Budget) -> float:
    """The standard uncertainty that the terms make together."""
    return float(sum(term**2 for term in budget.values()) ** 0.5)


def taken_apart(quality: Quality, parts: Mapping[str, Budget]) -> Quality:
    """The same numbers with uncertainties made of the parts; the term "choice" that they had is kept.

    Parameters
    ----------
    parts : mapping of a number's name to its terms
    """
    budgets = {}
    for name, own in quality.budgets.items():
        terms = {**parts.get(name, own)}
        terms["choice"] = own["choice"]
        budgets[name] = {term: terms.get(term, 0.0) for term in TERMS}
    numbers = {name: replace(number, uncertainty=combined(budgets[name])) for name, number in quality.numbers.items()}
    return replace(quality, numbers=numbers, budgets=budgets)


def with_settling(quality: Quality, share: float) -> Quality:
    """The same numbers with what MTF50 and its like may still move, a share of them, when s or k is raised."""
    budgets = {}
    for name, terms in quality.budgets.items():
        move = share * quality.numbers[name].value if name.startswith(FREQUENCIES) else 0.0
        budgets[name] = {**terms, "choice": float((terms["choice"] ** 2 + move**2) ** 0.5)}
    numbers = {name: replace(number, uncertainty=combined(budgets[name])) for name, number in quality.numbers.items()}
    return replace(quality, numbers=numbers, budgets=budgets)
