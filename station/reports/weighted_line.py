"""Weighted straight-line fit, and the significance of its slope."""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from procedures.numerics.arrays import Array


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
    tail = stats.t.sf(score, freedom) if birge > 1 else stats.norm.sf(score)
    return WeightedLine(
        float(slope), float(slope_uncertainty), float(mean), float(mean_uncertainty), centre, birge, float(2 * tail),
        len(x),
    )  # fmt: skip
