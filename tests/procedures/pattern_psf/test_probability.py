"""The probability that a number lies within two stated uncertainties, from the statistics of its checks."""

import math

import pytest

from procedures.numbers import NUMBERS, PROBABILITY, Group
from procedures.outcome import Check, Verdict
from procedures.pattern_psf.probability import LARGEST, calibration, features, probability


def check(name: str, statistic: float, threshold: float = 2.0, **more: bool) -> Check:
    return Check(name, statistic, threshold, Verdict.DOUBTFUL, "a reason", "a remedy", **more)


def test_features_are_statistics_over_thresholds_by_name():
    checks = [
        check("a", 1.0), check("a", 3.0), check("b", 4.0, least=True), check("c", 100.0),
        check("d", 9.0, given=False),
    ]  # fmt: skip
    known = features(checks, 0.01)
    assert (known["a"], known["b"], known["c"]) == (1.5, 0.5, LARGEST)
    assert "d" not in known
    assert (known["largest"], known["second largest"]) == (LARGEST, 1.5)
    assert known["uncertainty"] == pytest.approx(0.0)


def test_a_probability_is_the_logistic_function_of_the_stored_coefficients():
    model = calibration()
    assert probability({}) == pytest.approx(1 / (1 + math.exp(-model["intercept"])))
    name, weight = max(model["coefficients"].items(), key=lambda one: abs(one[1]))
    assert (probability({name: 1.0}) > probability({})) == (weight > 0)


def test_sharpened_and_smoothed_photographs_are_less_probable():
    within = {"largest": 0.8, "second largest": 0.6}
    for name in ("sharpening", "smoothing", "noise correlation"):
        assert probability({**within, "largest": LARGEST, name: LARGEST}) < 0.5 * probability(within), name


def test_the_calibration_says_what_made_it():
    model = calibration()
    assert "verdict_probability.py" in model["made_by"]
    assert model["photographs"] > 100
    assert {Group.CERTIFIED, Group.HEADLINE, Group.SUMMARY} <= NUMBERS[PROBABILITY].groups
