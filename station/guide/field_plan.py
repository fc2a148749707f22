"""The guided plan of a field, with the estimate that puts the field together from its photographs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from procedures.facts import facts_as
from procedures.field import plan as guide
from procedures.field.conclusion import FieldResult, PlaneField, conclude
from procedures.field.facts import FieldFacts
from procedures.field.measuring import measure_frames
from procedures.outcome import BadParameter, Outcome, Refused, Verdict
from procedures.plan import Facts, Known, Outcomes, Plan
from procedures.raw import RawFrame
from station.calibration.field import centre_result, field_pixels, field_results
from station.calibration.planes import diffraction_limit
from station.results.plane_result import PlaneResult
from station.results.terms import Terms


@dataclass(frozen=True, eq=False)
class OfField:
    """One plane's part of a field, with the whole."""

    field: FieldResult
    plane: PlaneField
    pitch_um: float | None = None

    def results(self, terms: Terms) -> Sequence[PlaneResult]:
        """Those of all planes at the frame's centre, held to the terms at every place that these name."""
        pixels = field_pixels(self.field.measured, self.pitch_um)
        try:
            return field_results(self.field, terms, pixels, lambda plane: None)
        except BadParameter as error:
            return [terms.undecided(centre_result(one), error.reason) for one in self.field.planes]


def plan() -> Plan:
    """The plan."""
    return guide.plan(estimate)


def estimate(frames: Sequence[RawFrame], facts: Facts, known: Known) -> Outcomes:
    """Every plane's field from all photographs; a refusal in its place where they give none."""
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
    return {one.name: _outcome(found, one, told.pixel_pitch_um) for one in found.planes}


def _outcome(found: FieldResult, one: PlaneField, pitch_um: float | None) -> Outcome[OfField]:
    value = None if one.verdict is Verdict.REFUSED else OfField(found, one, pitch_um)
    return Outcome(value, one.verdict, one.reason, one.remedy)
