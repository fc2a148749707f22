"""The result of every plane of a field, as it travels: that of the PSF at the frame's centre."""

from __future__ import annotations

from procedures.field.conclusion import PlaneField
from station.results.plane_result import PlaneResult


def centre_result(one: PlaneField) -> PlaneResult:
    """One plane's answer; a refused one has a reason and a remedy alone."""
    if one.centre is None or one.interpolation is None:
        return PlaneResult(one.name, one.verdict, one.reason, one.remedy)
    values = {"nodes": one.nodes, "components": len(one.interpolation.field.components)}
    return PlaneResult.of(
        one.name, one.verdict, one.centre, one.quality, reason=one.reason, remedy=one.remedy, values=values
    )
