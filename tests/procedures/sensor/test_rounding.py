"""Numbers of a sensor whose noise is less than a digital number, against pictures that were rounded."""

import numpy as np
import pytest

from procedures.sensor.estimate import characterise
from procedures.sensor.rounding import rounded, unrounded
from tests.procedures.sensor.known_sensor import KnownSensor

SIZE = 96


@pytest.mark.parametrize(("mean", "sigma", "pixels"), [(0.2, 0.1, 0.3), (0.45, 0.3, 0.1), (0.0, 0.15, 0.2)])
def test_statistics_after_rounding_are_those_of_rounded_draws(rng, mean, sigma, pixels):
    n = 200_000
    of_pixel = mean + pixels * rng.standard_normal(n)
    first, second = (np.rint(of_pixel + sigma * rng.standard_normal(n)) for _ in range(2))
    drawn = first.mean(), np.var(first - second) / 2, np.cov(first, second)[0, 1]
    expected = rounded(*(np.array([one]) for one in (mean, sigma, pixels)))
    # of n values of a variance below 1/4: five standard errors
    np.testing.assert_allclose(drawn, [float(one[0]) for one in expected[:3]], atol=5 * 0.5 / n**0.5)


def test_noise_that_rounding_hides_is_between_bounds_and_large_noise_is_unchanged(rng):
    measured = np.array([np.full(3, 10.0), np.full(3, 9.0), np.full(3, 2.0)])
    before = unrounded(measured, np.full(3, 1e-6), rng)
    np.testing.assert_array_equal(before.temporal, measured[1])
    # all pixels have one number: the noise can be anything below a third of a digital number
    n = 100_000
    measured = np.array([np.full(1001, one) for one in (7.0, 1e-5, 1e-7)])
    before = unrounded(measured, np.array([1e-5, 1e-5, 1e-7]) / n, rng)
    sigma = np.sqrt(before.temporal - 1 / 12)
    assert sigma.min() < 0.07
    assert 0.08 < sigma.max() < 0.35


def numbers_of(sigma_dn: float, seed: int) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
    """Truth and 95 % intervals of a sensor of 8 bits with a dark noise in digital numbers."""
    rng = np.random.default_rng([seed, int(100 * sigma_dn)])
    gain = float(np.exp(rng.uniform(np.log(0.012), np.log(0.05))))
    sensor = KnownSensor(
        rows=SIZE, columns=SIZE, gain=gain, dark_noise_e=sigma_dn / gain, offset=float(rng.uniform(6, 10)), top=255,
        dsnu_dn=float(rng.uniform(0.05, 0.5)), prnu=0.008, seed=seed,
    )  # fmt: skip
    result = characterise(sensor.record(seed, np.linspace(0.04, 1.2, 24), 16), rng).value
    offset, response, _ = sensor.patterns
    truth = {
        "system_gain": gain,
        "quantum_efficiency": sensor.efficiency * float(response.mean()),
        "temporal_dark_noise": sensor.dark_noise_e,
        "dsnu_dn": float(np.std(offset)),
        "prnu": 100 * float(np.std(response) / response.mean()),
    }
    return truth, {name: (result.numbers[name].low, result.numbers[name].high) for name in truth}


@pytest.mark.nightly
def test_intervals_of_numbers_below_a_digital_number_hold_the_truth():
    cases = [numbers_of(sigma, seed) for sigma in (0.1, 0.2, 0.3, 0.5) for seed in range(4)]
    for name in cases[0][0]:
        inside = sum(intervals[name][0] <= truth[name] <= intervals[name][1] for truth, intervals in cases)
        # of 16 intervals of 95 %, fewer than 13 hold the truth with a probability of 0.8 %
        assert inside >= 13, name


def test_gain_is_right_where_the_dark_is_darker_than_rounding():
    truth, intervals = numbers_of(0.2, 0)
    low, high = intervals["system_gain"]
    middle, half = (low + high) / 2, (high - low) / 2
    assert abs(truth["system_gain"] - middle) < 2 * half  # four standard uncertainties
    assert half < 0.02 * middle
