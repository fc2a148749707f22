"""The result of every plane of a field, as it travels: that of the PSF at the frame's centre."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from procedures.field.conclusion import FieldResult, Limit, PlaneField
from procedures.field.maps import MAPS, numbers_of, radius_direction
from procedures.field.measuring import MeasuredFrames
from procedures.numbers import MTF50_MERIDIONAL, MTF50_RADIAL, MTF50_SAGITTAL, OF_PLACES
from procedures.outcome import BadInput, Outcome, Quantity
from procedures.psf_field import PsfField
from procedures.quality import Diffraction, assess
from procedures.reading.arrays import checked_array
from procedures.sensor.photon_transfer import GainAndNoise
from procedures.whole_camera.from_field import CameraPart, sensor_parts, vignetting_parts
from station.calibration.sensor_models import sensor_record
from station.calibration.vignetting import read_joint_formula
from station.results.limits import Place, Specification, Spot
from station.results.plane_result import PlaneResult
from station.results.terms import Terms
from station.results.units import Pixels, convert_quantity

_GIVE = "measure it again: results of older versions have no joint covariance"
SHAPES = {"values": (2,), "covariance": (2, 2)}


def other_parts(vignetting: Path | None, sensor: Path | None) -> list[CameraPart]:
    """The parts from results of `vignetting` and `sensor`. Raises BadInput for others, or without a covariance."""
    parts = vignetting_parts(read_joint_formula(vignetting)) if vignetting else []
    return parts + (sensor_parts(read_gain_and_noise(sensor)) if sensor else [])


def read_gain_and_noise(path: Path) -> dict[str, GainAndNoise]:
    """Gain and dark noise of every plane of a sensor's record. Raises BadInput where it has none."""
    with sensor_record(path) as stored:
        planes = stored.data["planes"]
        entries = {name: plane["gain_and_noise"] for name, plane in planes.items() if "gain_and_noise" in plane}
        if not entries:
            raise BadInput(f"{path} has no covariance of gain and noise for any plane", _GIVE)
        return {
            name: GainAndNoise(*(
                checked_array(entry[key], f"{key} of gain and noise", shape, remedy=_GIVE)
                for key, shape in SHAPES.items()
            ))
            for name, entry in entries.items()
        }  # fmt: skip


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
        diagnostics=estimate.subject,
    )  # fmt: skip


def field_pixels(measured: MeasuredFrames, pitch_um: float | None = None) -> dict[str, Pixels]:
    """Pixels of every plane for units of frequency; a given pitch takes precedence over the camera's."""
    known = pitch_um or next((exposure.exposure.pixel_pitch_um for exposure in measured.exposures), None)
    return {name: Pixels(plane.pitch, known, min(plane.samples.shape)) for name, plane in measured.planes.items()}


def field_results(result: FieldResult, terms: Terms, pixels: Mapping[str, Pixels], limit: Limit) -> list[PlaneResult]:
    """Every plane's, in their order, held to the specification at all places that it names, in the unit asked for."""
    records = []
    for name, outcome in result.planes.items():
        plane = result.measured.planes[name]
        spots = field_spots(outcome.value, terms.specification, terms.frequencies(pixels[name]), limit(plane))
        records.append(terms.apply(centre_result(name, outcome, plane.pitch), pixels[name], spots))
    return records


OUT = 0.8
"""How far out, of the frame's half sides, its sides and corners are sampled."""
REACH = (1.0, 0.875, 0.75, 0.625, 0.5)
"""Shares of that where the numbers of a certificate are, the first at which the nodes reach most places."""
SAME_AS = {str(MTF50_SAGITTAL): str(MTF50_RADIAL), str(MTF50_MERIDIONAL): str(MTF50_RADIAL)}
"""Numbers of a plane's centre with the uncertainty of those about the radius."""
COLUMNS = {-1: "left", 0: "", 1: "right"}
ROWS = {-1: "upper", 0: "", 1: "lower"}


def field_spots(
    one: PlaneField | None, specification: Specification, at: Sequence[float], limit: Diffraction | None
) -> tuple[Spot, ...]:
    """The numbers of a plane wherever its specification has limits, without numbers where the nodes do not reach."""
    if one is None or not specification.limits:
        return ()
    wanted = set(specification.places)
    field, everywhere = one.interpolation.field, Place.ANYWHERE in wanted
    return tuple(
        Spot(name, (place,), _numbers(field, u, v, at, limit) if _reached(field, u, v) else {})
        for name, place, u, v in _nine()
        if everywhere or place in wanted
    )


def shared_uncertainties(field: PsfField, plane: PlaneResult) -> dict[str, float]:
    """By how much, in quadrature, uncertainties of a plane's result at the centre exceed the field's own there: by the
    blur of the print and other causes that all places share."""
    shared = {}
    for name, own in _in_unit(field, 0, 0, plane).items():
        whole = plane.numbers.get(SAME_AS.get(name, name), own)
        shared[name] = math.sqrt(max(whole.uncertainty**2 - own.uncertainty**2, 0.0))
    return shared


def field_places(field: PsfField, plane: PlaneResult) -> tuple[float, dict[str, dict[str, Quantity]]]:
    """How far out the nodes reach around the frame, of its half sides, and the numbers at the nine places there."""
    share = max(REACH, key=lambda share: sum(_reached(field, share * u, share * v) for _, _, u, v in _nine()))
    shared = shared_uncertainties(field, plane)
    return share * OUT, {
        place: {
            name: replace(one, uncertainty=math.hypot(one.uncertainty, shared[name]))
            for name, one in _in_unit(field, share * u, share * v, plane).items()
        }
        for place, _, u, v in _nine()
        if _reached(field, share * u, share * v)
    }


def _in_unit(field: PsfField, u: float, v: float, plane: PlaneResult) -> dict[str, Quantity]:
    numbers = _numbers(field, u, v, (), None)
    return {name: convert_quantity(number, plane.unit, plane.factor) for name, number in numbers.items()}


def _nine() -> Iterator[tuple[str, Place, float, float]]:
    """Name, kind and position of the nine places, from -1 to 1 of the half sides."""
    for j, row in ROWS.items():
        for i, column in COLUMNS.items():
            place = (Place.CENTRE, Place.SIDES, Place.CORNERS)[abs(i) + abs(j)]
            kind = {Place.CENTRE: "centre", Place.SIDES: "side", Place.CORNERS: "corner"}[place]
            yield " ".join(word for word in (row, column, kind) if word), place, OUT * i, OUT * j


def _position(field: PsfField, u: float, v: float) -> tuple[float, float]:
    rows, columns = field.shape
    return (1 + u) * (columns - 1) / 2, (1 + v) * (rows - 1) / 2


def _reached(field: PsfField, u: float, v: float) -> bool:
    return bool(field.inside(np.array([_position(field, u, v)]))[0])


def _numbers(
    field: PsfField, u: float, v: float, at: Sequence[float], limit: Diffraction | None
) -> dict[str, Quantity]:
    """All numbers of the PSF at a place, and those about the radius, with the field's own error in them."""
    x, y = _position(field, u, v)
    psf, n = field.at(x, y), len(field.nodes)
    numbers = dict(assess(psf, n=n, diffraction=limit, at=at).numbers)
    values, uncertainties = numbers_of(psf, radius_direction(field.shape, x, y))
    for one, value, uncertainty in zip(MAPS, values, uncertainties, strict=True):
        if one in OF_PLACES:
            numbers[one] = Quantity(float(value), one.unit, float(uncertainty), one.label, n)
    return numbers
