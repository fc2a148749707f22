"""Numbers at a bound: one-sided uncertainties from the rise of chi-square."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from procedures.numbers import STREHL_LENS, WAVEFRONT_RMS, WAVEFRONT_RMS_NM
from procedures.outcome import Quantity
from procedures.physics.fit import ModelFit, WhitenedPsf, distance_of_rise, start_near
from procedures.physics.model import bounds_of, names_of
from procedures.physics.pupil import TERMS

AT_BOUND = 1e-3
"""Fraction of a parameter's range within which it counts as at its bound."""
PROBES = ("defocus", "astigmatism", "coma_x", "spherical")
"""Aberrations tried one at a time for the largest that the data allow where the fit has none."""
LARGEST_PROBE = 0.25


@dataclass(frozen=True)
class OneSided:
    """A number at its bound. `best` is the unconstrained optimum, at or beyond the bound; `follows` marks a number that
    restates another one."""

    name: str
    bound: float
    uncertainty: float
    best: float
    follows: bool = False

    @property
    def words(self) -> str:
        """Description of the limit."""
        name = self.name.replace("_", " ")
        if self.best != self.bound:
            return f"{name} fits best at {self.best:.3g}, beyond its bound {self.bound:g}"
        return f"{name} is at its bound {self.bound:g}, within {self.uncertainty:.2g}"

    def quantity(self, number: Quantity) -> Quantity:
        """The number with its one-sided uncertainty."""
        method = f"{number.method}; at its bound: chi-square rises by 1 over this distance, on one side"
        return replace(number, value=self.bound, uncertainty=self.uncertainty, method=method)


def at_bounds(data: WhitenedPsf, fit: ModelFit, numbers: dict[str, Quantity]) -> list[OneSided]:
    """Numbers of a fit that are limited on one side: parameters at bounds, fill factor above 1, Strehl ratio 1 with
    wavefront error 0.

    `numbers` are the fit's, with uncertainties from its curvature.
    """
    limits = [_parameter(data, fit, name, numbers[name]) for name in fit.parts.names]
    return [limit for limit in (*limits, _fill_factor(numbers["fill_factor"]), *_no_aberrations(data, fit)) if limit]


def _parameter(data: WhitenedPsf, fit: ModelFit, name: str, number: Quantity) -> OneSided | None:
    place = names_of(fit.parts).index(name)
    low, high = (float(limits[place]) for limits in bounds_of(fit.parts))
    for bound, inward in ((low, 1.0), (high, -1.0)):
        if abs(number.value - bound) < AT_BOUND * (high - low):
            return OneSided(name, bound, distance_of_rise(data, fit, name, bound, inward), bound)
    return None


def _fill_factor(number: Quantity) -> OneSided | None:
    """Limit of the fill factor, as a photosite is no larger than its pixel. With chi-square ((f - best) / u)^2, it
    rises by 1 over its value at f = 1 at u (sqrt(d^2 + 1) - d) below, d = (best - 1) / u."""
    if number.value <= 1:
        return None
    d = (number.value - 1) / max(number.uncertainty, 1e-9)
    return OneSided("fill_factor", 1.0, number.uncertainty * (float(np.hypot(d, 1)) - d), number.value)


def _no_aberrations(data: WhitenedPsf, fit: ModelFit) -> list[OneSided]:
    """Limits where a fit needs no aberrations: the loss of Strehl ratio by the least visible aberration, and the
    largest wavefront error of any of them."""
    if fit.parts.aberrations:
        return []
    hidden, drops = [], []
    for term in (TERMS.index(name) for name in PROBES):
        parts = replace(fit.parts, aberrations=(term,))
        p = start_near(fit, parts)
        p[-1] = 0.0
        started = replace(fit, parts=parts, p=p)
        hidden.append(min(distance_of_rise(data, started, TERMS[term], 0.0, 1.0), LARGEST_PROBE))
        drops.append(1 - data.grid.pupil.strehl(hidden[-1] * np.eye(len(TERMS))[term]))
    nm = data.grid.diffraction.wavelength_nm
    return [
        OneSided(STREHL_LENS, 1.0, max(drops), 1.0),
        OneSided(WAVEFRONT_RMS, 0.0, max(hidden), 0.0, follows=True),
        OneSided(WAVEFRONT_RMS_NM, 0.0, nm * max(hidden), 0.0, follows=True),
    ]
