"""The uncertainty of a number taken apart: what each source adds to it, as a calibration laboratory is audited on.

Every term is a standard uncertainty in the number's own unit; they are independent, and the root of the sum of their
squares is the number's. Source: ISO/IEC Guide 98-3 (GUM), section 5.1 and annex H.
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


def with_frequencies(quality: Quality, psf: Psf, at: Sequence[float]) -> Quality:
    """The same numbers, and the MTF at more frequencies (cycles per pixel of the plane).

    Their uncertainties are made up as that of the MTF at Nyquist along the same direction is: each term in proportion
    to what the PSF's covariance gives.
    """
    n = next((one.n for one in quality.numbers.values()), 0)
    fresh = assess(psf, n=n, at=at)
    numbers, budgets = dict(quality.numbers), dict(quality.budgets)
    for name, number in fresh.numbers.items():
        if (told := frequency_of(name)) is None or name in numbers:
            continue
        like = MTF_NYQUIST[told[1]]
        own, whole = fresh.budgets[name]["noise"], fresh.budgets[like]["noise"]
        terms = {term: value * own / max(whole, 1e-300) for term, value in quality.budgets[like].items()}
        budgets[name] = {**terms, "choice": fresh.budgets[name]["choice"]}
        numbers[name] = replace(number, uncertainty=combined(budgets[name]))
    return replace(quality, numbers=numbers, budgets=budgets, at=tuple(at))


def with_settling(quality: Quality, share: float) -> Quality:
    """The same numbers with what MTF50 and its like may still move, a share of them, when s or k is raised."""
    budgets = {}
    for name, terms in quality.budgets.items():
        move = share * quality.numbers[name].value if name.startswith(FREQUENCIES) else 0.0
        budgets[name] = {**terms, "choice": float((terms["choice"] ** 2 + move**2) ** 0.5)}
    numbers = {name: replace(number, uncertainty=combined(budgets[name])) for name, number in quality.numbers.items()}
    return replace(quality, numbers=numbers, budgets=budgets)
