from dataclasses import dataclass, field, replace
from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import pytest

from procedures import assess
from procedures.outcome import Outcome, Quantity, Verdict
from station.calibration import planes
from tests.psfs import gaussian


@lru_cache
def found(s=None, k=None):
    """An estimate with an undetermined number."""
    psf = gaussian(0.5**0.5, s or 4, k or 17)
    quality = assess(psf, n=9800)
    unknown = Quantity(float("nan"), "1", float("inf"), "of no light", 0)
    numbers = {**quality.numbers, "unknown": unknown}
    quality = replace(quality, numbers=numbers, budgets={**quality.budgets, "unknown": {"noise": float("inf")}})
    return SimpleNamespace(
        psf=psf,
        quality=quality,
        values={
            "gamma": 0.5,
            "gamma_bound": 0.35,
            "residual_std": np.float64(1.02),
            "pixels_per_pattern": 101.3,
            "s_over_t": 1.58,
        },
        charts=(),
        choice=(),
        variations=(),
        diffraction=None,
        inter_image=None,
        diagnostics={"saturated_share": 0.0, "whiteness": float("nan")},
    )


@dataclass
class Estimator:
    """Stand-in for the estimator: outcomes by plane, and a record of the calls."""

    answers: dict[str, Outcome]
    asked: list
    sensors: list = field(default_factory=list)

    def __call__(self, plane, chart, parameters, diffraction=None, *, sensor=None):
        self.asked.append((plane, chart, parameters, diffraction))
        self.sensors.append(sensor)
        answer = self.answers.get(plane.name, Outcome(found(parameters.s, parameters.k)))
        if isinstance(answer, BaseException):
            raise answer
        return answer


@pytest.fixture
def refused():
    return Outcome(None, Verdict.REFUSED, "no chart was found in 328 x 292 pixels", "photograph the whole chart")


@pytest.fixture
def doubtful():
    return Outcome(found(), Verdict.DOUBTFUL, "s/t is 2.4, above 2", "come closer or print a larger chart")


@pytest.fixture
def estimator(monkeypatch):
    stand_in = Estimator({}, [])
    monkeypatch.setattr(planes, "estimate_psf", stand_in)
    monkeypatch.setattr(planes, "check_edges", lambda plane, found: ())
    return stand_in
