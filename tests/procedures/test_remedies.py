"""Remedies of all checks: a RAW file is not asked for where one was given."""

import re
from collections.abc import Callable, Iterable
from dataclasses import fields
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from procedures.choice import Trial
from procedures.correction import checks as correction
from procedures.corruption.family import Strength
from procedures.outcome import Check
from procedures.pattern_psf import diagnostics as of_chart
from procedures.pattern_psf import trust as chart
from procedures.psf import Sampling
from procedures.raw import Plane
from procedures.slanted_edge import trust as edge
from procedures.slanted_edge.corruptions import corruption_checks
from procedures.slanted_edge.evidence import Evidence
from procedures.slanted_edge.tail import Tail
from procedures.two_photo import diagnostics as of_pair
from procedures.two_photo import trust as pair

ASKS_FOR_RAW = re.compile(r"\b(use|take|give)\b[^;:]*\bRAW\b|\bas RAW files\b")
TRIED = (Trial(2, 11, (None, None), uncertainty=0.0004, truncation=0.1, band_edge=0.06),)


def of_ones(kind: type) -> Any:
    return kind(**{one.name: 1.0 for one in fields(kind)})


def of_a_chart(raw: bool, sensor: Any = None, **changed: float) -> Iterable[Check]:
    d = SimpleNamespace(**{**vars(of_ones(of_chart.Diagnostics)), **changed})
    fit = SimpleNamespace(converged=False, observation=[1.0])
    inputs = chart.VerdictInputs(Sampling(2, 11, "ls", ()), False, TRIED, (), [], sensor, raw)
    return chart.checks_of(d, fit, inputs)


def of_a_pair(raw: bool) -> Iterable[Check]:
    return pair.checks_of(of_ones(of_pair.PairDiagnostics), Sampling(2, 11, "ls", ()), TRIED, 2, [], raw=raw)


def of_an_edge(raw: bool) -> Iterable[Check]:
    numbers = dict.fromkeys(("contrast", "noise", "empty", "unevenness", "end_px", "width_px"), 1.0)
    profile = SimpleNamespace(**numbers, tail_prior=Tail(0.1), tail_estimate=Tail(1.0))
    mask = Strength(1.0, 1.0)
    evidence = Evidence([mask], [mask], *[mask] * 4, -9.0, 1.0, 9.0, 0.1, 9.0, 9.0, 1, 9.0, -9.0, 0.0, 0.0)
    return [*edge.checks_of(SimpleNamespace(mean_slope=0.1), profile, 0.3, 0.1), *corruption_checks(evidence, raw=raw)]


def of_a_correction(raw: bool) -> Iterable[Check]:
    plane = Plane("Y", np.ones((32, 32), np.float32), 1e-3, raw=raw)
    noise = SimpleNamespace(whiteness=0.1, rise=0.1, variance_at=np.ones_like)
    return correction.checks_of({"Y": plane}, {"Y": noise})


@pytest.mark.parametrize(
    "checks",
    [
        of_a_chart,
        lambda raw: of_a_chart(raw, SimpleNamespace(gain_uncertainty=0.1, gain=1.0)),
        lambda raw: of_a_chart(raw, tail_sigmas=-5.0),
        of_a_pair,
        of_an_edge,
        of_a_correction,
    ],
)
def test_a_raw_file_is_asked_for_only_where_there_is_none(checks: Callable[[bool], Iterable[Check]]) -> None:
    asked = {raw: [one.remedy for one in checks(raw) if ASKS_FOR_RAW.search(one.remedy)] for raw in (True, False)}
    assert asked[True] == []
    assert asked[False]


def test_a_sensor_that_is_calibrated_is_not_to_be_calibrated() -> None:
    remedies = {
        sensor is None: next(one.remedy for one in of_a_chart(True, sensor) if one.name == "response")
        for sensor in (None, SimpleNamespace(gain_uncertainty=0.1, gain=1.0))
    }
    assert "calibrate" in remedies[True]
    assert "calibrate" not in remedies[False]
