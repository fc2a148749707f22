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
    estimate = outcome.value
    if estimate is None:
        return PlaneResult.of_outcome(name, outcome, pitch=pitch)
    field = estimate.interpolation.field
    return PlaneResult.of(
        name, outcome.verdict, estimate.centre, estimate.quality, reason=outcome.reason, remedy=outcome.remedy,
        other_causes=outcome.other_causes, pitch=estimate.pitch, estimate=estimate,
        values={"nodes": len(field.nodes), "components": len(field.components)}, place=str(Place.CENTRE),
    )  # fmt: skip


def field_pixels(measured: MeasuredFrames, pitch_um: float | None = None) -> dict[str, Pixels]:
    """Pixels of every plane for units of frequency; a given pitch takes precedence over the camera's."""
    known = pitch_um or next((one.exposure.pixel_pitch_um for one in measured.exposures), None)
    return {name: Pixels(one.pitch, known, min(one.samples.shape)) for name, one in measured.planes.items()}


def field_results(result: FieldResult, terms: Terms, pixels: Mapping[str, Pixels], limit: Limit) -> list[PlaneResult]:
    """Every plane's, in their order, held to the specification at all places that it names, in the unit asked for."""
    return [_in_terms(name, result, terms, pixels[name], limit) for name in result.planes]


def _in_terms(name: str, result: FieldResult, terms: Terms, pixels: Pixels, limit: Limit) -> PlaneResult:
    outcome, plane = result.planes[name], result.measured.planes[name]
    spots = field_spots(outcome.value, terms.specification, terms.frequencies(pixels), limit(plane))
    return terms.apply(centre_result(name, outcome, plane.pitch), pixels, spots)
