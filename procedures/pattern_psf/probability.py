"""Probability that the headline number lies within two stated uncertainties, from the statistics of the checks.

A logistic model of the checks' statistics over their thresholds, with coefficients fitted to photographs of an
independent renderer, clean and damaged (`tests/benchmarks/verdict_probability.py`, which writes `probability.json`).
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from functools import lru_cache
from importlib.resources import files
from typing import Any

import numpy as np

from procedures.outcome import Check

FILE = "probability.json"
LARGEST = 4.0
"""Ratio of statistic and threshold above which a check says no more."""


def features(checks: Iterable[Check], relative_uncertainty: float) -> dict[str, float]:
    """Statistics over thresholds by the checks' names, the largest two, and the logarithm of the uncertainty."""
    ratios: dict[str, float] = {}
    for one in checks:
        if one.given and one.threshold:
            over, under = (one.threshold, one.statistic) if one.least else (one.statistic, one.threshold)
            ratio = over / under if over < LARGEST * under else LARGEST
            ratios[one.name] = max(ratios.get(one.name, 0.0), float(np.clip(ratio, 0.0, LARGEST)))
    largest = [*sorted(ratios.values(), reverse=True), 0.0, 0.0]
    return {
        **ratios,
        "largest": largest[0],
        "second largest": largest[1],
        "uncertainty": float(np.log(max(relative_uncertainty, 1e-4) / 0.01)),
    }


@lru_cache(maxsize=1)
def calibration() -> Mapping[str, Any]:
    """Coefficients by the features' names, the intercept, and their provenance; empty without a calibration."""
    file = files(__package__).joinpath(FILE)
    read: Mapping[str, Any] = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
    return read


def probability(given: Mapping[str, float]) -> float:
    """Probability that the number lies within two stated uncertainties; `given` are the `features`."""
    model = calibration()
    score = model["intercept"] + sum(weight * given.get(name, 0.0) for name, weight in model["coefficients"].items())
    return float(1 / (1 + np.exp(-score)))
