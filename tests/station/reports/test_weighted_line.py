import numpy as np
import pytest

from station.reports.trend import weighted_line

X = np.array([0.0, 0.4, 1.1, 1.5, 3.0, 3.2])
U = np.array([0.1, 0.2, 0.1, 0.3, 0.1, 0.2])


def test_a_line_is_that_of_numpys_fit_with_the_scatter_it_states(rng):
    line = weighted_line(X, 2.0 - 0.5 * X, U)
    # rounding only
    assert line.slope == pytest.approx(-0.5, rel=1e-12)
    np.testing.assert_allclose(line.at(X)[0], 2.0 - 0.5 * X, rtol=1e-12)
    assert line.birge == pytest.approx(0.0, abs=1e-6)
    # scatter below the stated uncertainties, so that nothing is scaled
    y = 1.0 + 0.2 * X + 0.3 * U * rng.normal(size=6)
    line = weighted_line(X, y, U)
    (slope, level), covariance = np.polyfit(X, y, 1, w=1 / U, cov="unscaled")
    assert line.birge < 1
    assert line.slope == pytest.approx(slope, rel=1e-9)
    assert line.slope_uncertainty == pytest.approx(covariance[0, 0] ** 0.5, rel=1e-9)
    value, uncertainty = line.at(np.zeros(1))
    assert value[0] == pytest.approx(level, rel=1e-9)
    assert uncertainty[0] == pytest.approx(covariance[1, 1] ** 0.5, rel=1e-9)
    lines = [weighted_line(X, 0.2 * X + U * rng.normal(size=6), U) for _ in range(2000)]
    expected = np.sum(U**-2.0 * (X - lines[0].centre) ** 2) ** -0.5
    # the deviation of 2000 draws is known to 1/sqrt(4000) = 1.6 %, four of them
    assert np.std([line.slope for line in lines]) == pytest.approx(expected, rel=0.064)
    assert all(line.slope_uncertainty >= expected * (1 - 1e-12) for line in lines)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1.0, 5.0])
def test_no_slope_is_significant_where_there_is_none(rng, factor):
    # whether or not the stated uncertainties are right; 5 % of 2000 are 100, with a deviation of 10
    count = sum(weighted_line(X, factor * U * rng.normal(size=6), U).p_value < 0.05 for _ in range(2000))
    assert count < 100 + 4 * 10


def test_scatter_widens_uncertainties_and_two_points_have_none(rng):
    line = weighted_line(X, 10 * U * rng.normal(size=6), U)
    stated = weighted_line(X, 0 * X, U).slope_uncertainty
    assert line.slope_uncertainty == pytest.approx(line.birge * stated, rel=1e-12)
    line = weighted_line(np.array([0.0, 2.0]), np.array([1.0, 2.0]), np.array([0.3, 0.4]))
    assert line.slope == pytest.approx(0.5)
    assert line.slope_uncertainty == pytest.approx(0.25)  # sqrt(0.3^2 + 0.4^2) / 2
    assert np.isnan(line.birge)


@pytest.mark.parametrize(
    ("x", "u", "words"), [([1.0, 1.0], [1.0, 1.0], "different x"), ([0.0, 1.0], [0.0, 1.0], "above")]
)
def test_points_without_a_line_are_named(x, u, words):
    with pytest.raises(ValueError, match=words):
        weighted_line(np.array(x), np.array([0.0, 1.0]), np.array(u))
