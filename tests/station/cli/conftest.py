from __future__ import annotations

import sys
from dataclasses import dataclass
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from procedures.outcome import BadParameter, Outcome, Quantity, Verdict
from procedures.psf import Psf
from station.__main__ import main

FREQUENCIES = np.array([0.0, 0.25, 0.5])


def gaussian_psf(s=4, k=17):
    x = (np.arange(k) - k // 2) / s
    h = np.exp(-(x[:, None] ** 2 + x**2))
    return Psf(h / h.sum(), s, np.eye(k * k) * 1e-8)


def found(s=4, k=17, gamma=0.5):
    """What a procedure finds, with a number that could not be determined."""
    curves = {
        f"mtf_{name}{suffix}": value
        for name in ("horizontal", "vertical", "radial")
        for suffix, value in (("", np.array([1, 0.6, 0.1])), ("_uncertainty", np.array([0, 0.01, 0.02])))
    }
    numbers = {
        "mtf50_horizontal": Quantity(0.31, "cycles/pixel", 0.004, "where the MTF crosses one half", 9800),
        "fwhm": Quantity(float("nan"), "pixel", float("inf"), "width at half maximum", 9800),
    }
    quality = SimpleNamespace(frequencies=FREQUENCIES, numbers=numbers, **curves)
    return SimpleNamespace(
        psf=gaussian_psf(s, k),
        quality=quality,
        gamma=gamma,
        gamma_bound=0.35,
        residual_std=np.float64(1.02),
        pixels_per_pattern=101.3,
        s_over_t=1.58,
        diagnostics={"saturated_share": 0.0, "whiteness": float("nan")},
    )


@dataclass
class Estimator:
    """Stands in for the estimator: answers by plane, and remembers what it was asked."""

    answers: dict[str, Outcome]
    asked: list

    def __call__(self, plane, chart, parameters, exposure=None):
        self.asked.append((plane, chart, parameters, exposure))
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
    @dataclass(frozen=True)
    class PatternParameters:
        s: int = 4
        k: int = 17
        solver: str = "ls"

        def __post_init__(self):
            if self.s < 2:
                raise BadParameter(f"s is at least 2; got {self.s}", "give -s 4")

    module = ModuleType("procedures.pattern_psf.estimate")
    module.PatternParameters = PatternParameters
    module.estimate_psf = Estimator({}, [])
    monkeypatch.setitem(sys.modules, module.__name__, module)
    return module.estimate_psf


@pytest.fixture
def run():
    """Run the program in this process: `run("psf", "pattern", ...)`."""
    return lambda *words: CliRunner().invoke(main, [str(word) for word in words], prog_name="station")
