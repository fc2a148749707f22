"""The names of all numbers in their order, with the words of pages and terminals: the one place where they stand.

What a page, a table or a screen tells is a choice of these names, made where it is told.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from procedures.transfer_function import LEVELS, frequency_of


@dataclass(frozen=True)
class Words:
    """A number in words: as a page says it, and as a narrow terminal does."""

    words: str
    short: str = ""


DIRECTIONS = {
    "horizontal": Words("along rows", "rows"),
    "vertical": Words("along columns", "columns"),
    "radial": Words("mean over directions", "mean"),
    "sagittal": Words("of sagittal detail", "sagittal"),
    "meridional": Words("of meridional detail", "meridional"),
}
"""In which an MTF is told."""


def _levels() -> dict[str, Words]:
    """The frequencies of levels of the MTF, along rows, along columns, and of the mean."""
    found = {}
    for level in LEVELS:
        for name in ("horizontal", "vertical", "radial"):
            own, comma = DIRECTIONS[name], "," if name == "radial" else ""
            short = f"MTF{level}" if name == "radial" else f"MTF{level}, {own.short}"
            found[f"mtf{level}_{name}"] = Words(f"MTF{level}{comma} {own.words}", short)
    return found


QUANTITIES: Mapping[str, Words] = {
    **_levels(),
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


OF_EDGES: Mapping[str, Words] = {
    **{f"mtf{level}": Words(f"MTF{level} across the edge", f"MTF{level}") for level in LEVELS},
    "mtf_nyquist": Words("MTF at Nyquist across the edge", "at Nyquist"),
    "angle": Words("Angle of the edge", "angle"),
}
"""Numbers of an edge."""
OF_PLACES: Mapping[str, Words] = {
    "mtf50_sagittal": Words("MTF50 of sagittal detail", "MTF50, sagittal"),
    "mtf50_meridional": Words("MTF50 of meridional detail", "MTF50, meridional"),
    "astigmatism": Words("MTF50, sagittal less meridional", "astigmatism"),
}
"""Numbers that a place of a field has beside those of its PSF."""
BEFORE_PHOTOSITES: Mapping[str, Words] = {
    f"{name}_without_photosite": Words(f"{one.words}, without the photosite") for name, one in OF_PLACES.items()
}
"""Numbers of maps that are not the camera's."""
OF_RESTORATIONS: Mapping[str, Words] = {
    "w_median": Words("Blur w, median over the frame", "w, median"),
    "w_least": Words("Blur w, least of the frame", "w, least"),
    "w_greatest": Words("Blur w, greatest of the frame", "w, greatest"),
    "residual_over_noise": Words("What is left over, over the noise", "left over / noise"),
    "undetermined": Words("Share of the frame without a sure depth", "no sure depth"),
}
"""Numbers of a restored scene."""
MEDIAN = "_median"
"""Ends the name of a number of a field's map."""
_ALL = {**QUANTITIES, **VALUES, **OF_EDGES, **OF_PLACES, **BEFORE_PHOTOSITES, **OF_RESTORATIONS}


def words_of(name: str, unit: str = "cycles/pixel") -> Words:
    """A number in words; `unit` is that of the frequency in its name, where it has one."""
    if name not in _ALL and name.endswith(MEDIAN):
        return Words(f"{words_of(name.removesuffix(MEDIAN), unit).words}, median over the frame")
    if (told := frequency_of(name)) is None:
        return _ALL.get(name, Words(name))
    frequency, direction = told
    own = DIRECTIONS.get(direction, Words("across the edge", "edge"))
    return Words(f"MTF at {frequency:.4g} {unit} {own.words}", f"at {frequency:.4g}, {own.short}")


def titled(names: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Names of numbers with their words, for pages."""
    return tuple((name, words_of(name).words) for name in names)


def short(name: str) -> str:
    """A number in few words, for terminals and tables."""
    words = words_of(name)
    return words.short or words.words
