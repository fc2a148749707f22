"""The result of every plane of a field, as it travels: that of the PSF at the frame's centre."""

from __future__ import annotations

from procedures.field.conclusion import FieldResult, PlaneField
from procedures.outcome import Outcome
from station.results.plane_result import PlaneResult


def centre_results(found: FieldResult) -> list[PlaneResult]:
    """Every plane's, in their order."""
    return [centre_result(name, one) for name, one in found.planes.items()]


def centre_result(name: str, outcome: Outcome[PlaneField]) -> PlaneResult:
    """One plane's; a refused one has a reason and a remedy alone."""
    found, verdict, reason, remedy = outcome.value, outcome.verdict, outcome.reason, outcome.remedy
    if found is None:
        return PlaneResult(name, verdict, reason, remedy)
    field = found.interpolation.field
    values = {"nodes": len(field.nodes), "components": len(field.components)}
    return PlaneResult.of(
        name, verdict, found.centre, found.quality, reason=reason, remedy=remedy, values=values, found=found
    )
