"""The guided plan of a field, with the estimate that puts the field together from its photographs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

from procedures.facts import facts_as
from procedures.field import plan as guide
from procedures.field.conclusion import FieldResult, PlaneField, conclude
from procedures.field.facts import FieldFacts
from procedures.field.measuring import measure_frames
from procedures.outcome import Outcome, Refused, Verdict
from procedures.plan import Facts, Known, Outcomes, Plan
from procedures.raw import RawFrame
from station.calibration.field import centre_result
from station.calibration.planes import diffraction_limit
from station.results.plane_result import PlaneResult


def plan() -> Plan:
    """The plan."""
    return guide.plan(estimate)


def estimate(frames: Sequence[RawFrame], facts: Facts, known: Known) -> Outcomes:
    """By plane the whole field, with the plane's verdict; a refusal in its place where the photographs give none."""
    told = facts_as(FieldFacts, facts)
    measured = measure_frames(frames, told.chart, told.parameters)
    exposure = measured.exposures[0].exposure if measured.exposures else None
    limit = (
        partial(diffraction_limit, exposure, pixel_pitch_um=told.pixel_pitch_um) if exposure else (lambda plane: None)
    )
    try:
        found = conclude(measured, limit=limit)
    except Refused as refusal:
        names = frames[0].planes if frames else ()
        return {name: Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy) for name in names}
    return {name: _of_whole(found, one) for name, one in found.planes.items()}


def _of_whole(found: FieldResult, one: Outcome[PlaneField]) -> Outcome[FieldResult]:
    return Outcome(None if one.value is None else found, one.verdict, one.reason, one.remedy)


def results(outcomes: Mapping[str, Outcome[FieldResult]]) -> list[PlaneResult]:
    """Every plane's result, that of the PSF at the frame's centre, with the whole field as what was found."""
    return [_result(name, outcome) for name, outcome in outcomes.items()]


def _result(name: str, outcome: Outcome[FieldResult]) -> PlaneResult:
    whole = outcome.value
    if whole is None:
        return PlaneResult(name, outcome.verdict, outcome.reason, outcome.remedy)
    return replace(centre_result(name, whole.planes[name]), found=whole)
