"""A series of one lens, from one mounting: its numbers over aperture, focus and ISO, and which aperture is best.

Photographs of the same settings are put together: their mean weighted by their uncertainties, which grow where the
photographs scatter more than these say (Birge's ratio).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from procedures.numbers import EDGE_MTF50, MTF50_HORIZONTAL, MTF50_VERTICAL, STREHL, WAVEFRONT_RMS, label
from procedures.pattern_psf.focus.sweep import Peak, best_focus
from station.common.sanitise import printable
from station.results.exports import csv_bytes

TABLE, PAGE = "series.csv", "series.html"
TITLES: Mapping[str, str] = {EDGE_MTF50: "MTF50, mean of rows and columns", WAVEFRONT_RMS: "Wavefront error, rms"}
DRAWS, SEED = 20_000, 1


@dataclass(frozen=True)
class SeriesSetting:
    """Setting of the camera; None where it recorded nothing. `focus_steps` are small steps of the ring to infinity."""

    f_number: float | None
    focus_mm: float | None
    iso: float | None
    focus_steps: float | None = None


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
    def short(self) -> str:
        """The setting in few characters."""
        return f"f/{self.f_number:g}"

    @property
    def words(self) -> str:
        """The setting as a sentence."""
        value = f"{self.value:.4g} ± {self.uncertainty:.2g} {self.unit}"
        return f"{self.plane}: best at f/{self.f_number:g}, MTF50 {value}, with a confidence of {self.confidence:.0%}"


NUMBERS: Mapping[str, tuple[str, ...]] = {
    EDGE_MTF50: (MTF50_HORIZONTAL, MTF50_VERTICAL),
    STREHL: (STREHL,),
    WAVEFRONT_RMS: (WAVEFRONT_RMS,),
}
"""Numbers of a series, each the mean of numbers of a plane."""
ONE = {"camera": "cameras", "lens": "lenses", "focal_length_mm": "focal lengths"}
"""Entries of a row that are the same throughout a series."""


NOTED = ("f_number", "focus_distance_mm", "iso", "focus_steps")


def points_of(rows: Sequence[Any]) -> list[Point]:
    """Every number of every plane at every setting, in order, from the usable rows of a batch."""
    means: dict[tuple[str, str, SeriesSetting], list[tuple[float, float, str]]] = {}
    contents: set[tuple[str, ...]] = set()
    for row in rows:
        content = tuple(row.sha256)
        if content and content in contents:
            continue  # a copy is no second photograph
        contents.add(content)
        setting = SeriesSetting(*(_number(row.noted.get(key)) for key in NOTED))
        for plane, one in row.planes.items():
            for number, parts in NUMBERS.items() if one.verdict in ("pass", "doubtful") else ():
                if all(part in one.numbers for part in parts):
                    numbers = [one.numbers[part] for part in parts]  # of one photograph: their errors are correlated
                    value = sum(part["value"] for part in numbers) / len(parts)
                    uncertainty = sum(part.get("uncertainty", 0.0) for part in numbers) / len(parts)
                    mean = (value, uncertainty, numbers[0].get("unit", "1"))
                    means.setdefault((plane, number, setting), []).append(mean)
    points = [Point(*key, *together(shots), shots[0][2], len(shots)) for key, shots in means.items()]
    return sorted(points, key=_order)


def several(rows: Sequence[Any]) -> list[str]:
    """Sentences on what differs among photographs that should be of one lens on one camera from one mounting."""
    settings = []
    for key, words in ONE.items():
        values = sorted({str(row.noted[key]) for row in rows if key in row.noted})
        if len(values) > 1:
            settings.append(f"the photographs are of several {words}: {', '.join(map(printable, values))}")
    return settings


def _order(point: Point) -> tuple[Any, ...]:
    return point.plane, point.number, *(-inf if value is None else value for value in vars(point.setting).values())


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) else None


def together(shots: Sequence[tuple[float, float, str]]) -> tuple[float, float]:
    """The weighted mean of photographs, and its standard uncertainty."""
    values, spreads = (np.array([shot[i] for shot in shots], dtype=np.float64) for i in (0, 1))
    weights = 1 / np.maximum(spreads, 1e-12) ** 2
    mean = float(weights @ values / weights.sum())
    own = float(weights.sum() ** -0.5)
    freedom = len(values) - 1
    birge = math.sqrt(float(weights @ (values - mean) ** 2) / freedom) if freedom else 1.0
    return mean, own * max(1.0, birge)


def best_apertures(points: Sequence[Point]) -> list[Best]:
    """The f-number with the greatest MTF50 of every plane, at its best focus and ISO, where there are several."""
    best = []
    for plane in dict.fromkeys(point.plane for point in points):
        own = [one for one in points if one.plane == plane and one.number == EDGE_MTF50 and one.setting.f_number]
        by_aperture: dict[float, Point] = {}
        for one in own:
            f_number = one.setting.f_number or 0.0
            if f_number not in by_aperture or one.value > by_aperture[f_number].value:
                by_aperture[f_number] = one
        if len(by_aperture) > 1:
            best.append(_best(plane, by_aperture))
    return best


def _best(plane: str, by_aperture: Mapping[float, Point]) -> Best:
    """The chance is the share of draws from the points' uncertainties in which the aperture is the best."""
    points = list(by_aperture.values())
    values, spreads = np.array([(point.value, point.uncertainty) for point in points]).T
    drawn = values + spreads * np.random.default_rng(SEED).standard_normal((DRAWS, len(points)))
    i = int(np.argmax(values))
    chance = float(np.mean(drawn.argmax(axis=1) == i))
    return Best(plane, list(by_aperture)[i], chance, points[i].value, points[i].uncertainty, points[i].unit)


@dataclass(frozen=True)
class BestFocus:
    """The sharpest position of the focus ring of a plane."""

    plane: str
    peak: Peak

    @property
    def short(self) -> str:
        """The position in few characters."""
        return f"{self.peak.place:+.2f} steps"

    @property
    def words(self) -> str:
        """The position as a sentence."""
        one = self.peak
        at = f"{one.place:+.2f} ± {one.place_uncertainty:.2f} steps of the ring"
        return f"{self.plane}: sharpest at {at}, MTF50 {one.score:.4g} ± {one.score_uncertainty:.2g} cycles/pixel"


def best_focuses(points: Sequence[Point]) -> list[BestFocus]:
    """The sharpest focus of every plane whose MTF50 has a maximum over the steps of the ring."""
    best = []
    for plane in dict.fromkeys(point.plane for point in points):
        own = [point for point in points if point.plane == plane and point.number == EDGE_MTF50]
        steps = [math.nan if one.setting.focus_steps is None else one.setting.focus_steps for one in own]
        peak = best_focus(steps, [one.value for one in own], [one.uncertainty for one in own])
        if peak is not None:
            best.append(BestFocus(plane, peak))
    return best


def series_table(points: Sequence[Point]) -> bytes:
    """All points as CSV."""
    head = ["plane", "number", "f_number", "focus_distance [mm]", "iso", "focus_steps", "value", "uncertainty", "unit",
            "photographs"]  # fmt: skip
    rows = [
        [
            point.plane, point.number,
            *("" if value is None else f"{value:.9g}" for value in vars(point.setting).values()),
            f"{point.value:.9g}", f"{point.uncertainty:.9g}", point.unit, str(point.photographs),
        ]
        for point in points
    ]  # fmt: skip
    return csv_bytes([head, *rows])
