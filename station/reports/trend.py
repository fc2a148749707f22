"""How a camera's numbers change over its sessions: a weighted line through each, and whether it drifts at all."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from scipy.special import ndtr, stdtr

from procedures.numbers import MTF50_HORIZONTAL, MTF50_VERTICAL
from procedures.numerics.arrays import Array
from procedures.raw import GREY_PLANE, MOSAIC_PLANES
from station.sessions.index import IndexedNumber


@dataclass(frozen=True)
class WeightedLine:
    """y = mean + slope (x - centre), with standard uncertainties.

    centre : the weighted mean of x, where slope and mean are uncorrelated
    birge : birge ratio sqrt(chi^2 / (n - 2)): scatter about the line over the stated uncertainties; NaN for two points
    p_value : probability of a slope at least as far from 0 if the true slope is 0
    """

    slope: float
    slope_uncertainty: float
    mean: float
    mean_uncertainty: float
    centre: float
    birge: float
    p_value: float
    n: int

    def at(self, x: Array) -> tuple[Array, Array]:
        """The line and its standard uncertainty at x, (n,) each."""
        away = np.asarray(x, dtype=np.float64) - self.centre
        return self.mean + self.slope * away, np.hypot(self.mean_uncertainty, self.slope_uncertainty * away)


def weighted_line(x: Array, y: Array, uncertainty: Array) -> WeightedLine:
    """The line of least weighted squares, weights 1 / uncertainty^2.

    If the scatter exceeds the uncertainties, these are taken as too small by the Birge ratio: the uncertainties of the
    line grow by it, and the significance is from Student's distribution with n - 2 degrees of freedom. Otherwise they
    are used unchanged, with the normal distribution.

    Raises ValueError if the points determine no line.

    x, y, uncertainty : (n,) float64
        n >= 2; at least two different x; uncertainties above 0.

    Source: R. T. Birge, Phys. Rev. 40 (1932) 207; P. R. Bevington, Data Reduction and Error Analysis, chapter 6.
    """
    x, y, u = (np.asarray(values, dtype=np.float64) for values in (x, y, uncertainty))
    if len(np.unique(x)) < 2:
        raise ValueError(
            f"a line needs two points at different x; got {len(x)} over a range of {np.ptp(x) if len(x) else 0:g}"
        )
    if not np.all(u > 0):
        raise ValueError("each point needs an uncertainty above 0")
    w = u**-2
    centre, freedom = float(np.average(x, weights=w)), len(x) - 2
    (slope, mean), covariance = np.polyfit(x - centre, y, 1, w=1 / u, cov="unscaled")
    chi2 = float(np.sum(w * (y - mean - slope * (x - centre)) ** 2))
    birge = (chi2 / freedom) ** 0.5 if freedom else float("nan")
    slope_uncertainty, mean_uncertainty = (birge if birge > 1 else 1.0) * np.sqrt(np.diag(covariance))
    score = abs(slope) / slope_uncertainty
    tail = stdtr(freedom, -score) if birge > 1 else ndtr(-score)
    return WeightedLine(
        float(slope), float(slope_uncertainty), float(mean), float(mean_uncertainty), centre, birge, float(2 * tail),
        len(x),
    )  # fmt: skip


QUANTITIES = (MTF50_HORIZONTAL, MTF50_VERTICAL)
YEAR_S = 365.25 * 86400.0
FEWEST = 3
"""Sessions that are needed to distinguish drift from scatter."""
SIGNIFICANT = 0.01
"""Probability of a slope as steep by chance, below which it is called a drift."""


@dataclass(frozen=True)
class Trend:
    """One quantity of one plane of a camera with one lens, by one plan, over time.

    points : the sessions, oldest first
    line : over years since the first session; None where all are of one moment, or there are too few
    """

    lens: str
    plan: str
    plane: str
    quantity: str
    unit: str
    points: tuple[IndexedNumber, ...]
    line: WeightedLine | None

    @property
    def years(self) -> Array:
        """When the sessions began, in years since the first."""
        return years_of(self.points)

    @property
    def drifts(self) -> bool | None:
        """Whether the slope is significant; None with too few sessions."""
        if self.line is None or self.line.n < FEWEST:
            return None
        return self.line.p_value < SIGNIFICANT

    @property
    def finding(self) -> str:
        """The trend in a few words."""
        if self.line is None or self.drifts is None:
            return f"needs {FEWEST} sessions at different times"
        if self.drifts:
            return "falls" if self.line.slope < 0 else "rises"
        return "no significant drift"


def years_of(points: Sequence[IndexedNumber]) -> Array:
    """When the sessions of the points began, in years since the first of them, (n,)."""
    return np.array([years_between(points[0].began, point.began) for point in points])


def years_between(before: str, after: str) -> float:
    """Years from one moment to another, both in ISO 8601."""
    return (datetime.fromisoformat(after) - datetime.fromisoformat(before)).total_seconds() / YEAR_S


def trends(measured: Sequence[IndexedNumber]) -> list[Trend]:
    """A trend for every lens, plan, plane and quantity; refused planes have no numbers and are excluded."""
    groups = itertools.groupby(sorted(measured, key=_series), _series)
    return [_trend(tuple(points)) for _, points in groups]


def _series(number: IndexedNumber) -> tuple[str, str, str, int, str, str]:
    """Quantities that may be compared over time; in the order of lists, planes as in the mosaic."""
    planes = (*MOSAIC_PLANES, GREY_PLANE)
    place = planes.index(number.plane) if number.plane in planes else len(planes)
    return number.lens, number.plan, number.quantity, place, number.plane, number.unit


def _trend(points: tuple[IndexedNumber, ...]) -> Trend:
    years = years_of(points)
    line = None
    if len(np.unique(years)) > 1:
        values, uncertainties = np.array([(point.value, point.uncertainty) for point in points]).T
        line = weighted_line(years, values, uncertainties)
    first = points[0]
    return Trend(first.lens, first.plan, first.plane, first.quantity, first.unit, points, line)
