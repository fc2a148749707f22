"""The result of every plane of a field, as it travels: that of the PSF at the frame's centre."""

from __future__ import annotations

from collections.abc import Mapping

from procedures.field.conclusion import FieldResult, Limit, PlaneField
from procedures.field.measuring import MeasuredFrames
from procedures.outcome import Outcome
from station.calibration.field_spots import field_spots
from station.results.limits import Place
from station.results.plane_result import PlaneResult
from station.results.terms import Terms
from station.results.units import Pixels


def centre_result(name: str, outcome: Outcome[PlaneField], pitch: int = 1) -> PlaneResult:
    """One plane's; a refused one has a reason and a remedy alone."""
    found = outcome.value
    if found is None:
        return PlaneResult.of_outcome(name, outcome, pitch=pitch)
    field = found.interpolation.field
    return PlaneResult.of(
        name, outcome.verdict, found.centre, found.quality, reason=outcome.reason, remedy=outcome.remedy,
        other_causes=outcome.other_causes, pitch=found.pitch, found=found,
        values={"nodes": len(field.nodes), "components": len(field.components)}, place=str(Place.CENTRE),
    )  # fmt: skip


def field_pixels(measured: MeasuredFrames, pitch_um: float | None = None) -> dict[str, Pixels]:
    """What the frequencies of every plane are counted in; a pitch that is given counts before the camera's own."""
    known = pitch_um or next((one.exposure.pixel_pitch_um for one in measured.exposures), None)
    return {name: Pixels(one.pitch, known, min(one.samples.shape)) for name, one in measured.planes.items()}


def field_results(found: FieldResult, terms: Terms, pixels: Mapping[str, Pixels], limit: Limit) -> list[PlaneResult]:
    """Every plane's, in their order, held to the specification at all places that it names, in the unit asked for."""
    return [_in_terms(name, found, terms, pixels[name], limit) for name in found.planes]


def _in_terms(name: str, found: FieldResult, terms: Terms, pixels: Pixels, limit: Limit) -> PlaneResult:
    outcome, plane = found.planes[name], found.measured.planes[name]
    spots = field_spots(outcome.value, terms.specification, terms.frequencies(pixels), limit(plane))
    return terms.apply(centre_result(name, outcome, plane.pitch), pixels, spots)
