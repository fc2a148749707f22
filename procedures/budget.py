"""Uncertainty budgets: contributions of the sources to the uncertainty of a number.

Every term is a standard uncertainty in the unit of the number. The terms are independent; the root of the sum of their
squares is the combined uncertainty. Source: ISO/IEC Guide 98-3 (GUM), section 5.1 and annex H.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from procedures.numbers import LEVELS, frequency_of, name_at
from procedures.psf import Psf
from procedures.quality import KNOTS, Quality, assess

Array = npt.NDArray[np.float64]

Budget = Mapping[str, float]
"""Terms by name, each a standard uncertainty."""

TERMS = {
    "noise": "noise of the samples",
    "light": "light and response",
    "sensor": "the sensor's response, as calibrated",
    "geometry": "geometry",
    "print": "printed edges",
    "tail": "energy outside the support",
    "mismatch": "model error in the residual",
    "focus": "focus at either distance",
    "choice": "choice of s and k",
}
"""Descriptions of the terms, in the order of reports."""

FREQUENCIES = tuple(f"mtf{level}_" for level in LEVELS)
"""Prefixes of the numbers that are frequencies."""


def combined(budget: Budget) -> float:
    """Combined standard uncertainty."""
    return float(sum(term**2 for term in budget.values()) ** 0.5)


def with_parts(quality: Quality, parts: Mapping[str, Budget]) -> Quality:
    """Replace the uncertainties of numbers and curves by those of the parts; the term "choice" is kept.

    Parameters
    ----------
    parts : mapping of a number's name to its terms; for the curves, their values at the frequencies `KNOTS`
    """
    budgets = {}
    for name, terms_before in quality.budgets.items():
        terms = {**parts.get(name, terms_before)}
        terms["choice"] = terms_before["choice"]
        budgets[name] = {term: terms.get(term, 0.0) for term in TERMS}
    numbers = {name: replace(number, uncertainty=combined(budgets[name])) for name, number in quality.numbers.items()}
    curves = {name: _curve_budget(quality, name, parts) for name in quality.curve_budgets}
    return replace(quality, numbers=numbers, budgets=budgets, curve_budgets=curves)


def knot_budgets(quality: Quality) -> dict[str, Budget]:
    """Budgets of the curves at the frequencies `KNOTS`, by the names of the MTF there."""
    return {
        name_at(quality.frequencies[i], direction): {term: float(curve[i]) for term, curve in terms.items()}
        for direction, terms in quality.curve_budgets.items()
        for i in range(len(quality.frequencies))[KNOTS]
    }


def _curve_budget(quality: Quality, direction: str, parts: Mapping[str, Budget]) -> dict[str, Array]:
    """Terms of a curve: its noise times the terms over the noise, interpolated between the knots."""
    before = quality.curve_budgets[direction]
    f, noise = quality.frequencies[KNOTS], np.maximum(before["noise"][KNOTS], 1e-300)
    terms = [parts.get(name_at(one, direction), {"noise": u}) for one, u in zip(f, noise, strict=True)]
    curve = {
        term: before["noise"] * np.interp(quality.frequencies, f, [one.get(term, 0.0) for one in terms] / noise)
        for term in TERMS
        if term != "choice"
    }
    return {**curve, "choice": before["choice"]}


def with_frequencies(quality: Quality, psf: Psf, at: Sequence[float]) -> Quality:
    """Add the MTF at further frequencies, in cycles per pixel of the plane, with the budgets of the curves."""
    n = next((one.n for one in quality.numbers.values()), 0)
    fresh = assess(psf, n=n, at=at)
    numbers, budgets = dict(quality.numbers), dict(quality.budgets)
    for name, number in fresh.numbers.items():
        if (frequency := frequency_of(name)) is None or name in numbers:
            continue
        terms = quality.curve_budgets[frequency[1]].items()
        budgets[name] = {term: float(np.interp(frequency[0], quality.frequencies, curve)) for term, curve in terms}
        numbers[name] = replace(number, uncertainty=combined(budgets[name]))
    return replace(quality, numbers=numbers, budgets=budgets, at=tuple(at))
