"""Probability that the headline number lies within two stated uncertainties, from the statistics of the checks.

A logistic model of the checks' statistics over their thresholds, one for each kind of scene, with coefficients fitted
to photographs of an independent renderer, clean and damaged (`tests/benchmarks/verdict_probability.py`, which writes
`probability.json`).
"""

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


def features(checks: Iterable[Check], relative: float, printed: float, *, raw: bool) -> dict[str, float]:
    """Statistics over thresholds by the checks' names, the largest two, logarithms of the uncertainty without the
    print's blur and of what that adds, and whether it is a RAW file."""
    ratios: dict[str, float] = {}
    for check in checks:
        if check.given and check.threshold:
            over, under = (check.threshold, check.statistic) if check.least else (check.statistic, check.threshold)
            ratio = over / under if over < LARGEST * under else LARGEST
            ratios[check.name] = max(ratios.get(check.name, 0.0), float(np.clip(ratio, 0.0, LARGEST)))
    largest = [*sorted(ratios.values(), reverse=True), 0.0, 0.0]
    own = max(relative**2 - printed**2, 1e-8) ** 0.5
    return {
        **ratios,
        "largest": largest[0],
        "second largest": largest[1],
        "uncertainty": float(np.log(own / 0.01)),
        "print": float(np.log(max(relative / own, 1.0))),
        "raw": float(raw),
    }


@lru_cache(maxsize=1)
def calibration() -> Mapping[str, Any]:
    """Models by the names of scenes: coefficients by the features' names, the intercept, and their provenance."""
    read: Mapping[str, Any] = json.loads(files(__package__).joinpath(FILE).read_text(encoding="utf-8"))
    return read


def within_two(scene: str, checks: Iterable[Check], relative: float, *, raw: bool, printed: float = 0.0) -> float:
    """Probability that a number lies within two stated uncertainties.

    scene : "chart", "edge" or "wall"
    relative, printed : standard uncertainty over the number, and the part of it by the print's blur
    """
    model, given = calibration()[scene], features(checks, relative, printed, raw=raw)
    score = model["intercept"] + sum(weight * given.get(name, 0.0) for name, weight in model["coefficients"].items())
    return float(1 / (1 + np.exp(-score)))
