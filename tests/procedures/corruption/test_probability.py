"""The probability that a number lies within two stated uncertainties, from the statistics of its checks."""

import math

import pytest

from procedures.corruption.probability import LARGEST, calibration, features, within_two
from procedures.numbers import NUMBERS, PROBABILITY, Group
from procedures.outcome import Check, Verdict


def check(name: str, statistic: float, threshold: float = 2.0, **more: bool) -> Check:
    return Check(name, statistic, threshold, Verdict.DOUBTFUL, "a reason", "a remedy", **more)


def test_features_are_statistics_over_thresholds_by_name():
    checks = [
        check("a", 1.0), check("a", 3.0), check("b", 4.0, least=True), check("c", 100.0),
        check("d", 9.0, given=False),
    ]  # fmt: skip
    known = features(checks, 0.02, 0.0003**0.5, raw=True)
    assert (known["a"], known["b"], known["c"]) == (1.5, 0.5, LARGEST)
    assert "d" not in known
    assert (known["largest"], known["second largest"], known["raw"]) == (LARGEST, 1.5, 1.0)
    assert known["uncertainty"] == pytest.approx(0.0)
    assert known["print"] == pytest.approx(math.log(2))


@pytest.mark.parametrize("scene", ["chart", "edge", "wall"])
def test_the_calibration_of_every_scene_says_what_made_it_and_doubts_failed_checks(scene: str):
    model = calibration()[scene]
    assert "verdict_probability.py" in model["made_by"]
    assert model["photographs"] > 100
    weights = {name: weight for name, weight in model["coefficients"].items() if " " not in name and name != "largest"}
    worst = min(weights, key=lambda name: weights[name])
    good, failed = ([check(worst, statistic)] for statistic in (0.8, 99.0))
    assert within_two(scene, failed, 0.01, raw=False) < 0.9 * within_two(scene, good, 0.01, raw=False)


def test_the_probability_reaches_page_and_certificate():
    assert {Group.CERTIFIED, Group.HEADLINE, Group.SUMMARY} <= NUMBERS[PROBABILITY].groups
