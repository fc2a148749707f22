"""The result of every plane of a field, as it travels: that of the PSF at the frame's centre."""

from __future__ import annotations

from collections.abc import Mapping

from procedures.field.conclusion import FieldResult, Limit, PlaneField
from procedures.field.measuring import Measured
from station.calibration.field_spots import field_spots
from station.results.limits import Place
from station.results.plane_result import PlaneResult
from station.results.terms import Terms
from station.results.units import Pixels


def centre_result(one: PlaneField) -> PlaneResult:
    """One plane's answer; a refused one has a reason and a remedy alone."""
    if one.centre is None or one.interpolation is None:
        return PlaneResult(one.name, one.verdict, one.reason, one.remedy, pitch=one.pitch)
    values = {"nodes": one.nodes, "components": len(one.interpolation.field.components)}
    return PlaneResult.of(
        one.name, one.verdict, one.centre, one.quality, pitch=one.pitch, reason=one.reason, remedy=one.remedy,
        values=values, place=str(Place.CENTRE),
    )  # fmt: skip


def field_pixels(measured: Measured, pitch_um: float | None = None) -> dict[str, Pixels]:
    """What the frequencies of every plane are counted in; a pitch that is given counts before the camera's own."""
    known = pitch_um or next((one.exposure.pixel_pitch_um for one in measured.exposures), None)
    return {name: Pixels(one.pitch, known, min(one.samples.shape)) for name, one in measured.planes.items()}


def field_results(found: FieldResult, terms: Terms, pixels: Mapping[str, Pixels], limit: Limit) -> list[PlaneResult]:
    """Every plane's answer, held to its specification at all places that it names, in the unit that was asked for."""
    results = []
    for one in found.planes:
        own = pixels[one.name]
        diffraction = limit(found.measured.planes[one.name])
        spots = field_spots(one, terms.specification, terms.frequencies(own), diffraction)
        results.append(terms.told(centre_result(one), own, spots))
    return results
