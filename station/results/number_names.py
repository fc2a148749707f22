"""The names of all numbers in their order, with the words of pages and terminals: the one place where they stand.

What a page, a table or a screen tells is a choice of these names, made where it is told.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Words:
    """A number in words: as a page says it, and as a narrow terminal does."""

    words: str
    short: str = ""


QUANTITIES: Mapping[str, Words] = {
    "mtf50_horizontal": Words("MTF50 along rows", "MTF50, rows"),
    "mtf50_vertical": Words("MTF50 along columns", "MTF50, columns"),
    "mtf50_radial": Words("MTF50, mean over directions", "MTF50"),
    "mtf_nyquist_horizontal": Words("MTF at Nyquist along rows", "at Nyquist, rows"),
    "mtf_nyquist_vertical": Words("MTF at Nyquist along columns", "at Nyquist, columns"),
    "mtf_nyquist_radial": Words("MTF at Nyquist"),
    "energy_above_nyquist": Words("Energy above Nyquist", "above Nyquist"),
    "fwhm_horizontal": Words("Half maximum along rows", "FWHM, rows"),
    "fwhm_vertical": Words("Half maximum along columns", "FWHM, columns"),
    "encircled_energy_50": Words("Radius of 50 % energy", "50 % energy in"),
    "encircled_energy_80": Words("Radius of 80 % energy", "80 % energy in"),
    "ellipticity": Words("Ellipticity"),
    "ellipse_angle": Words("Direction of the long axis"),
    "centroid_x_support": Words("Centroid x, of the support"),
    "centroid_y_support": Words("Centroid y, of the support"),
    "strehl": Words("Strehl ratio with photosite", "Strehl ratio"),
    "gaussian_radius": Words("Gaussian radius for RAW developers"),
}
"""Numbers with a standard uncertainty."""

VALUES: Mapping[str, Words] = {
    "residual_std": Words("Residual, in standard deviations of the noise", "residual"),
    "gamma": Words("Noise amplification γ = Σ 1/σᵢ² of this view"),
    "gamma_bound": Words("The least γ that any chart could have"),
    "pixels_per_pattern": Words("Width of the noise region, in pixels"),
    "s_over_t": Words("Sampling ratio s/t"),
    "gain": Words("Contrast of the far photograph over the near one's"),
    "noise": Words("Noise, of the scale from black to white"),
}
"""Numbers without one."""


def titled(names: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Names of numbers with their words, for pages."""
    return tuple((name, {**QUANTITIES, **VALUES}[name].words) for name in names)


def short(name: str) -> str:
    """A number in few words, for terminals and tables."""
    words = {**QUANTITIES, **VALUES}[name]
    return words.short or words.words
