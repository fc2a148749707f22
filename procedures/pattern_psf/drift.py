"""Drift over a session: slopes of position, scale and sharpness of one chart's photographs against time or temperature.

The line y = a + b x is fitted by least squares. The standard deviation of a single photograph is the residual one, or
that of the photographs' own uncertainties where it is larger:

    u(b) = max(s, sqrt(mean u_i^2)) / sqrt(sum (x_i - mean x)^2),   s^2 = sum residual_i^2 / (n - 2).

An error of the temperature that changes from photograph to photograph is part of the residuals; it also flattens the
slope, by the variance of the error over that of the temperature.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from procedures.numbers import MTF50_HORIZONTAL, MTF50_VERTICAL
from procedures.numerics.arrays import Array
from procedures.pattern import CELLS
from procedures.pattern_psf.estimate import PatternPsf

FEWEST = 4  # photographs below which no slope is given


@dataclass(frozen=True)
class DriftSeries:
    """One number of every photograph, with its standard uncertainty; `unit` in words."""

    values: Array
    uncertainties: Array
    unit: str


@dataclass(frozen=True)
class Slope:
    """A slope and its standard uncertainty."""

    value: float
    uncertainty: float


def slope_of(x: Array, series: DriftSeries) -> Slope | None:
    """The slope against x (n,); None for fewer than `FEWEST` photographs, or constant x. Source: least squares; GUM,
    annex H.3."""
    y, centred = series.values, x - x.mean()
    spread = float(np.sum(centred**2))
    if len(y) < FEWEST or spread <= len(x) * np.finfo(np.float64).eps * float(np.abs(x).max()) ** 2:
        return None
    slope = float(centred @ y) / spread
    residual = y - y.mean() - slope * centred
    scatter = np.sqrt(float(residual @ residual) / (len(y) - 2))
    known = np.sqrt(float(np.mean(series.uncertainties**2)))
    return Slope(slope, float(max(scatter, known) / np.sqrt(spread)))


def chart_series(shots: Sequence[PatternPsf], pitch: int) -> Mapping[str, DriftSeries]:
    """Position, width and sharpness of the chart's image in photographs of one plane, whose pixels are `pitch` sensor
    pixels."""
    centre = np.full((1, 2), CELLS / 2)
    places = pitch * np.array([shot.registration.to_sensor(centre)[0] for shot in shots])
    sizes = pitch * np.array([shot.pixels_per_pattern for shot in shots])
    errors = pitch * np.sqrt([np.diag(shot.centre_covariance) for shot in shots])
    sharp = [[shot.quality.numbers[one] for one in (MTF50_HORIZONTAL, MTF50_VERTICAL)
              if one in shot.quality.numbers] for shot in shots]  # fmt: skip
    series = {
        "position, to the right": DriftSeries(places[:, 0], errors[:, 0], "px"),
        "position, down": DriftSeries(places[:, 1], errors[:, 1], "px"),
        "width of the chart's image": DriftSeries(sizes, np.zeros(len(sizes)), "px"),
    }
    if all(len(both) == 2 for both in sharp):
        mean = np.array([np.mean([one.value for one in both]) for both in sharp])
        u = np.array([np.linalg.norm([one.uncertainty for one in both]) / 2 for both in sharp])
        series["focus, as MTF50"] = DriftSeries(mean, u, "cycles/pixel")
    return series
