"""Quantiles and distinct values compared with NumPy's, which interpolate and sort in the same way."""

import numpy as np
import pytest

from procedures.numerics.arrays import distinct, quantile


@pytest.mark.parametrize("n", [1, 2, 7, 100])
@pytest.mark.parametrize("share", [0.0, 0.013, 0.5, 0.99, 1.0])
def test_quantiles_are_numpy_s(rng, n, share):
    values = rng.standard_normal(n)
    assert quantile(values, share) == pytest.approx(np.quantile(values, share), abs=1e-14)


@pytest.mark.parametrize("n", [0, 1, 50])
def test_distinct_values_are_ascending_and_complete(rng, n):
    values = rng.integers(0, 6, n)
    np.testing.assert_array_equal(distinct(values), np.unique(values))
