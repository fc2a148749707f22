"""Uncertainty budgets: contributions of the sources to the uncertainty of a number.

Every term is a standard uncertainty in the unit of the number. The terms are independent; the root of the sum of their
squares is the combined uncertainty. Source: ISO/IEC Guide 98-3 (GUM), section 5.1 and annex H.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from procedures.numbers import LEVELS, MTF_NYQUIST, frequency_of
from procedures.psf import Psf
from procedures.quality import Quality, assess

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
    """Replace the uncertainties of the numbers by those of the parts; the term "choice" is kept.

    Parameters
    ----------
    parts : mapping of a number's name to its terms
    """
    budgets = {}
    for name, terms_before in quality.budgets.items():
        terms = {**parts.get(name, terms_before)}
        terms["choice"] = terms_before["choice"]
        budgets[name] = {term: terms.get(term, 0.0) for term in TERMS}
    numbers = {name: replace(number, uncertainty=combined(budgets[name])) for name, number in quality.numbers.items()}
    return replace(quality, numbers=numbers, budgets=budgets)


def with_frequencies(quality: Quality, psf: Psf, at: Sequence[float]) -> Quality:
    """Add the MTF at further frequencies (cycles per pixel of the plane).

    Their budgets have the proportions of the MTF at Nyquist along the same direction, scaled by the uncertainty from
    the PSF's covariance.
    """
    n = next((one.n for one in quality.numbers.values()), 0)
    fresh = assess(psf, n=n, at=at)
    numbers, budgets = dict(quality.numbers), dict(quality.budgets)
    for name, number in fresh.numbers.items():
        if (frequency := frequency_of(name)) is None or name in numbers:
            continue
        reference = MTF_NYQUIST[frequency[1]]
        terms_before, whole = fresh.budgets[name]["noise"], fresh.budgets[reference]["noise"]
        terms = {term: value * terms_before / max(whole, 1e-300) for term, value in quality.budgets[reference].items()}
        budgets[name] = {**terms, "choice": fresh.budgets[name]["choice"]}
        numbers[name] = replace(number, uncertainty=combined(budgets[name]))
    return replace(quality, numbers=numbers, budgets=budgets, at=tuple(at))


def with_convergence(quality: Quality, share: float) -> Quality:
    """Add the relative change of MTF50 and similar numbers that is expected if k is raised to the term "choice"."""
    budgets = {}
    for name, terms in quality.budgets.items():
        move = share * quality.numbers[name].value if name.startswith(FREQUENCIES) else 0.0
        budgets[name] = {**terms, "choice": float((terms["choice"] ** 2 + move**2) ** 0.5)}
    numbers = {name: replace(number, uncertainty=combined(budgets[name])) for name, number in quality.numbers.items()}
    return replace(quality, numbers=numbers, budgets=budgets)
