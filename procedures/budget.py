"""Uncertainty budgets: contributions of the sources to the uncertainty of a number.

Every term is a standard uncertainty in the unit of the number. The terms are independent; the root of the sum of their
squares is the combined uncertainty. Source: ISO/IEC Guide 98-3 (GUM), section 5.1 and annex H.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from procedures.numbers import LEVELS, MTF_CROSSINGS, MTF_NYQUIST, frequency_of, name_at
from procedures.numerics.arrays import Array
from procedures.psf import Psf
from procedures.quality import KNOTS, Quality, assess

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
    "processing": "sharpening that noise and frame do not exclude",
    "variation": "variation of the PSF over the chart",
    "print blur": "blur of the print",
    "focus": "focus at either distance",
    "choice": "choice of s and k",
}
"""Descriptions of the terms, in the order of reports."""
UNSEEN = ("processing", "variation", "print blur")
"""Terms by corruptions that a photograph of the chart does not exclude."""
COMMON = ("mismatch", *UNSEEN)
"""Terms that may be common to all photographs of one chart by one camera."""
FREQUENCIES = tuple(f"mtf{level}_" for level in LEVELS)
"""Prefixes of the numbers that are frequencies."""


def combined(budget: Budget) -> float:
    """Combined standard uncertainty."""
    return float(sum(term**2 for term in budget.values()) ** 0.5)


def with_parts(quality: Quality, parts: Mapping[str, Budget]) -> Quality:
    """Replace the uncertainties of numbers and curves by those of the parts, at KNOTS for the curves; keep the term
    "choice"."""
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


def with_modes(quality: Quality, psf: Psf, modes: Mapping[str, Array]) -> Quality:
    """Add uncertain changes of the transfer function as terms of the budgets: modes are one standard deviation,
    relative, at `quality.frequencies`, alike in all directions."""
    budgets = {name: {**terms} for name, terms in quality.budgets.items()}
    of_curves = {name: {**terms} for name, terms in quality.curve_budgets.items()}
    curves = {way: getattr(quality, f"mtf_{way}") for way in of_curves}
    for term, change in modes.items():
        moved = _moved_samples(psf, quality.frequencies, change)
        for way, mtf in curves.items():
            of_curves[way][term] = np.hypot(of_curves[way].get(term, 0.0), mtf * change)
        for name, terms in budgets.items():
            terms[term] = math.hypot(terms.get(term, 0.0), _change_of(name, quality, curves, change, moved))
    numbers = {name: replace(number, uncertainty=combined(budgets[name])) for name, number in quality.numbers.items()}
    return replace(quality, numbers=numbers, budgets=budgets, curve_budgets=of_curves)


def _change_of(name: str, quality: Quality, curves: Mapping[str, Array], change: Array, moved: Array) -> float:
    """Change of a number by a relative change of the transfer function, or by that of the samples."""
    f = quality.frequencies
    for (level, way), crossed in MTF_CROSSINGS.items():
        if crossed == name:
            at, slope = quality.numbers[name].value, np.gradient(curves[way], f)
            return level / 100 * float(np.interp(at, f, change) / min(np.interp(at, f, slope), -1e-9))
    nyquist: dict[str, tuple[float, str]] = {number: (0.5, way) for way, number in MTF_NYQUIST.items()}
    if (at_frequency := nyquist.get(name) or frequency_of(name)) is not None:
        frequency, way = at_frequency
        return float(np.interp(frequency, f, curves[way] * change))
    return float(quality.gradients[name][: len(moved)] @ moved)


def _moved_samples(psf: Psf, f: Array, change: Array) -> Array:
    """Change (k^2,) of a PSF's samples by a relative change of its transfer function at frequencies f."""
    image = psf.extended()
    grid = np.hypot(*np.meshgrid(*(fft(len(image)) * psf.s for fft in (np.fft.rfftfreq, np.fft.fftfreq))))
    filtered = np.fft.irfft2(np.fft.rfft2(image) * np.interp(grid, f, change), image.shape)
    rim = (len(image) - psf.k) // 2
    return np.asarray(filtered[rim : rim + psf.k, rim : rim + psf.k].ravel())


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
