"""A series of one lens, from one mounting: its numbers over aperture, focus and ISO, and which aperture is best.

Photographs of the same settings are put together: their mean weighted by their uncertainties, which grow where the
photographs scatter more than these say (Birge's ratio).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from procedures.numbers import EDGE_MTF50, WAVEFRONT_RMS, label
from station.results.exports import csv_bytes

TABLE, PAGE = "series.csv", "series.html"
TITLES: Mapping[str, str] = {EDGE_MTF50: "MTF50, mean of rows and columns", WAVEFRONT_RMS: "Wavefront error, rms"}
DRAWS, SEED = 20_000, 1
"""Of the chance that an aperture is the best."""


@dataclass(frozen=True)
class SeriesSetting:
    """What was set: None where the camera noted nothing."""

    f_number: float | None
    focus_mm: float | None
    iso: float | None


@dataclass(frozen=True)
class Point:
    """A number of a plane at one setting, from so many photographs."""

    plane: str
    number: str
    setting: SeriesSetting
    value: float
    uncertainty: float
    unit: str
    photographs: int

    @property
    def title(self) -> str:
        """The number in words."""
        return TITLES.get(self.number) or label(self.number)


@dataclass(frozen=True)
class Best:
    """The aperture with the greatest MTF50 of a plane, and the chance that it is so."""

    plane: str
    f_number: float
    confidence: float
    value: float
    uncertainty: float
    unit: str

    @property
    def words(self) -> str:
        """As a sentence."""
        told = f"{self.value:.4g} ± {self.uncertainty:.2g} {self.unit}"
        return f"{self.plane}: best at f/{self.f_number:g}, MTF50 {told}, with a confidence of {self.confidence:.0%}"


def together(shots: Sequence[tuple[float, float, str]]) -> tuple[float, float]:
    """The weighted mean of photographs, and its standard uncertainty."""
    values, spreads = (np.array([one[i] for one in shots], dtype=np.float64) for i in (0, 1))
    weights = 1 / np.maximum(spreads, 1e-12) ** 2
    mean = float(weights @ values / weights.sum())
    own = float(weights.sum() ** -0.5)
    freedom = len(values) - 1
    birge = math.sqrt(float(weights @ (values - mean) ** 2) / freedom) if freedom else 1.0
    return mean, own * max(1.0, birge)


def best_apertures(points: Sequence[Point]) -> list[Best]:
    """Of every plane the f-number with the greatest MTF50, at its best focus and ISO, where there are several."""
    found = []
    for plane in dict.fromkeys(one.plane for one in points):
        own = [one for one in points if one.plane == plane and one.number == EDGE_MTF50 and one.setting.f_number]
        by_aperture: dict[float, Point] = {}
        for one in own:
            f_number = one.setting.f_number or 0.0
            if f_number not in by_aperture or one.value > by_aperture[f_number].value:
                by_aperture[f_number] = one
        if len(by_aperture) > 1:
            found.append(_best(plane, by_aperture))
    return found


def _best(plane: str, by_aperture: Mapping[float, Point]) -> Best:
    """The chance is the share of draws from the points' uncertainties in which the aperture is the best."""
    points = list(by_aperture.values())
    values, spreads = np.array([(one.value, one.uncertainty) for one in points]).T
    drawn = values + spreads * np.random.default_rng(SEED).standard_normal((DRAWS, len(points)))
    i = int(np.argmax(values))
    chance = float(np.mean(drawn.argmax(axis=1) == i))
    return Best(plane, list(by_aperture)[i], chance, points[i].value, points[i].uncertainty, points[i].unit)


def series_table(points: Sequence[Point]) -> bytes:
    """All points as CSV."""
    head = ["plane", "number", "f_number", "focus_distance [mm]", "iso", "value", "uncertainty", "unit", "photographs"]
    rows = [
        [
            one.plane, one.number, *(_cell(value) for value in vars(one.setting).values()), f"{one.value:.9g}",
            f"{one.uncertainty:.9g}", one.unit, str(one.photographs),
        ]
        for one in points
    ]  # fmt: skip
    return csv_bytes([head, *rows])


def _cell(value: float | None) -> str:
    return "" if value is None else f"{value:.9g}"
