"""Slopes over a session: against another implementation, their uncertainty, and a rail that expands."""

import numpy as np
import pytest
from scipy import stats

from procedures.pattern_psf.drift import DriftSeries, slope_of


def series(values, u=0.0):
    return DriftSeries(np.asarray(values, float), np.full(len(values), u), "px")


def test_a_slope_and_its_uncertainty_are_those_of_another_implementation_and_of_scatter(rng):
    x, y = rng.uniform(20, 25, 9), rng.normal(size=9)
    ours, theirs = slope_of(x, series(y)), stats.linregress(x, y)
    assert (ours.value, ours.uncertainty) == pytest.approx((theirs.slope, theirs.stderr), rel=1e-9)
    x = np.arange(5.0)
    # on a line without scatter: u over the root of the sum of squares of -2 .. 2
    assert slope_of(x, series(2 * x, u=0.3)).uncertainty == pytest.approx(0.3 / 10**0.5)
    x = np.linspace(20.0, 23.0, 8)
    slopes = [slope_of(x, series(0.7 * x + rng.normal(0, 0.05, 8))) for _ in range(1000)]
    values = np.array([one.value for one in slopes])
    # the mean of 1000 variances and the variance of 1000 slopes: each to a few percent
    assert np.mean([one.uncertainty**2 for one in slopes]) == pytest.approx(values.var(), rel=0.2)
    assert values.mean() == pytest.approx(0.7, abs=4 * values.std() / 1000**0.5)
    assert slope_of(np.arange(3.0), series([1, 2, 3])) is None
    assert slope_of(np.full(6, 21.3), series(range(6))) is None
