"""Uncertainty budgets: contributions of the sources to the uncertainty of a number.

Every term is a standard uncertainty in the unit of the number. The terms are independent; the root of the sum of their
squares is the combined uncertainty. Source: ISO/IEC Guide 98-3 (GUM), section 5.1 and annex H.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from procedures.numbers import LEVELS, MTF_CROSSINGS, MTF_NYQUIST, frequency_of
from procedures.psf import Psf
from procedures.quality import Quality, assess

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
    "processing": "sharpening that noise and frame do not exclude",
    "variation": "variation of the PSF over the chart",
    "print blur": "blur of the print",
    "focus": "focus at either distance",
    "choice": "choice of s and k",
}
"""Descriptions of the terms, in the order of reports."""
COMMON = ("mismatch", "processing", "variation", "print blur")
"""Terms that may be common to all photographs of one chart by one camera."""
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


def with_modes(quality: Quality, psf: Psf, modes: Mapping[str, Array]) -> Quality:
    """Add uncertain changes of the transfer function to numbers and curves: terms of the budget by their names.

    Parameters
    ----------
    modes : mapping of str to (n,) float64
        Relative change of the transfer function at `quality.frequencies`, alike in all directions: one standard
        deviation.
    """
    budgets = {name: {**terms} for name, terms in quality.budgets.items()}
    curves = {way: getattr(quality, f"mtf_{way}") for way in ("horizontal", "vertical", "radial")}
    squares = {way: getattr(quality, f"mtf_{way}_uncertainty") ** 2 for way in curves}
    for term, change in modes.items():
        moved = _moved_samples(psf, quality.frequencies, change)
        for way, mtf in curves.items():
            squares[way] = squares[way] + (mtf * change) ** 2
        for name, terms in budgets.items():
            terms[term] = math.hypot(terms.get(term, 0.0), _change_of(name, quality, curves, change, moved))
    bands = {f"mtf_{way}_uncertainty": np.sqrt(square) for way, square in squares.items()}
    numbers = {name: replace(number, uncertainty=combined(budgets[name])) for name, number in quality.numbers.items()}
    return replace(quality, numbers=numbers, budgets=budgets, **bands)


def _change_of(name: str, quality: Quality, curves: Mapping[str, Array], change: Array, moved: Array) -> float:
    """Change of a number by a relative change of the transfer function, or by that of the samples."""
    f = quality.frequencies
    for (level, way), crossed in MTF_CROSSINGS.items():
        if crossed == name:
            at, slope = quality.numbers[name].value, np.gradient(curves[way], f)
            return level / 100 * float(np.interp(at, f, change) / min(np.interp(at, f, slope), -1e-9))
    ways = {number: (0.5, way) for way, number in MTF_NYQUIST.items()}
    if (at_frequency := ways.get(name) or frequency_of(name)) is not None:
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
