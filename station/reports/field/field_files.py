"""Measurement of a field: the PSF at the frame's centre, `field.h5`, `camera.h5`, tables."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from procedures.choice import unseen_change
from procedures.field import field_file
from procedures.field.conclusion import FieldResult, PlaneField
from procedures.field.maps import FieldMap, HeightCurve, LateralColour, over_height
from procedures.field.photosite import Photosite, WithoutPhotosite
from procedures.numbers import CORNER_LIGHT, DARKEST_CORNER, ERROR_INTERPOLATION, ERROR_NOISE
from procedures.reading.exposure import Exposure
from procedures.vignetting.surface import LightSurface
from procedures.whole_camera.camera_file import write_camera_numbers
from procedures.whole_camera.from_field import WholeCamera
from station.calibration.camera_metadata import exposure_of
from station.common.versions import software
from station.reports.field.height_curves import FREQUENCIES, HEIGHTS, WITHOUT_PHOTOSITE, heights_table
from station.reports.otf_figures import FrequencyAxis
from station.results.measurement import Measurement
from station.results.plane_result import PlaneResult
from station.results.psf_files import psf_measurement
from station.results.record_head import PartBeside, RecordHead, verdict_entry
from station.results.result_files import json_text
from station.results.units import convert_quantity

FILE, CAMERA = "field.h5", "camera.h5"
MAX_CANDIDATES = 8


@dataclass(frozen=True, eq=False)
class FieldParts:
    """A field, and what else is known of the camera.

    camera : all numbers of the charts with one covariance
    lights : vignetting by plane, where it was measured
    beside : results of the other procedures of the same session
    """

    result: FieldResult
    camera: WholeCamera | None = None
    lights: Mapping[str, LightSurface] = field(default_factory=dict)
    beside: Mapping[str, PartBeside] = field(default_factory=dict)

    @cached_property
    def fitted(self) -> dict[str, PlaneField]:
        """The planes with a field."""
        return {name: plane.value for name, plane in self.result.planes.items() if plane.value is not None}

    @cached_property
    def heights(self) -> dict[str, dict[str, list[HeightCurve]]]:
        """The MTF over image height by the stem of its table and by plane."""
        photosite = self.result.photosite
        tables = {HEIGHTS: None} | ({WITHOUT_PHOTOSITE: photosite} if photosite else {})
        return {stem: _heights(self.fitted, without) for stem, without in tables.items()}

    def entry(self) -> dict[str, Any]:
        """Contents of `field` in the record."""
        result = self.result
        measured = result.measured
        entry = {
            "file": FILE,
            "frames": len(measured.frames),
            "failed": measured.failed,
            "misses": [asdict(miss) for miss in measured.misses],
            "doubtful_nodes": sum(bool(node.caveat) for nodes in measured.nodes.values() for node in nodes),
            "planes": {name: _plane_entry(one) for name, one in self.fitted.items()},
            "lateral_colour": {colour.plane: _colour_entry(colour) for colour in result.colours},
            **_focus_entry(result),
        }
        for name, light in self.lights.items() if self.fitted else ():
            rows, columns = light.shape
            corners = np.array([(x, y) for x in (0, columns - 1) for y in (0, rows - 1)], dtype=np.float64)
            shares = light.at(corners)
            lit = {CORNER_LIGHT: float(shares.mean()), DARKEST_CORNER: float(shares.min())}
            entry.setdefault("vignetting", {})[name] = lit
        if self.fitted and self.camera is not None:
            geometry, numbers = self.camera.geometry, self.camera.numbers
            known = verdict_entry(geometry)
            if geometry.value is not None:
                known["model"] = geometry.value.camera.model
                known |= {name: asdict(number) for name, number in geometry.value.numbers().items()}
            parts = [part.name for part in numbers.parts]
            entry["camera"] = {"file": CAMERA, "numbers": len(numbers.values), "parts": parts, "geometry": known}
        if self.beside:
            entry["parts"] = {name: asdict(one) for name, one in self.beside.items()}
        return entry

    def write(self, path: Path, provenance: Mapping[str, str]) -> None:
        """Write `field.h5`."""
        fields = {name: one.interpolation for name, one in self.fitted.items()}
        maps = {name: _maps(self.result, name, one) for name, one in self.fitted.items()}
        exposure = exposure_of(self.result.measured.exposures)
        field_file.write_field(path, fields, maps, self.result.colours, provenance, exposure)
        if self.lights:
            field_file.add_lights(path, self.lights)


def field_measurement(whole: FieldParts, planes: Sequence[PlaneResult], head: RecordHead) -> Measurement:
    """The measurement of a field; `planes` are the results at the frame's centre, in the requested terms."""
    measured = whole.result.measured
    files: dict[str, Any] = {}
    if whole.fitted:
        files[FILE] = partial(whole.write, provenance=_provenance(head))
        if (camera := whole.camera) is not None:
            files[CAMERA] = partial(write_camera_numbers, camera=camera, provenance=_provenance(head))
    for plane in planes:
        axis, mm = FrequencyAxis(str(plane.unit), plane.factor), mm_per_pixel(whole.result, plane.name, head.parameters)
        for stem, curves in whole.heights.items():
            if plane.name in curves:
                files[f"{stem}_{plane.name}.csv"] = heights_table(curves[plane.name], axis, mm)
    psf = psf_measurement(planes, replace(head, field=whole.entry()))
    exposure = measured.exposures[0].exposure if measured.exposures else Exposure()
    return replace(psf, files={**files, **psf.files}, exposure=exposure, result=whole)


def mm_per_pixel(result: FieldResult, plane: str, parameters: Mapping[str, Any]) -> float | None:
    """The pitch of a plane's pixels in mm, as given or recorded by the camera; None if it is unknown."""
    given = parameters.get("pixel_pitch_um")
    known = given or next((exposure.exposure.pixel_pitch_um for exposure in result.measured.exposures), None)
    return None if not known else result.measured.planes[plane].pitch * float(known) / 1000


def with_medians(one: PlaneResult, result: FieldResult) -> PlaneResult:
    """A plane's result with the medians of its maps among the numbers, in its unit."""
    outcome = result.planes.get(one.name)
    if outcome is None or outcome.value is None:
        return one
    medians = {name: convert_quantity(number, one.unit, one.factor) for name, number in outcome.value.numbers.items()}
    return replace(one, numbers={**one.numbers, **medians})


def _heights(fitted: Mapping[str, PlaneField], photosite: Photosite | None) -> dict[str, list[HeightCurve]]:
    """The MTF over image height of the planes with a field around the frame's centre."""
    curves = {}
    for name, one in fitted.items():
        without = WithoutPhotosite(photosite, one.pitch) if photosite else None
        common = unseen_change(one.quality, np.array(FREQUENCIES))
        curves[name] = over_height(one.interpolation.field, FREQUENCIES, without, common)
    return {name: curve for name, curve in curves.items() if curve}


def _maps(result: FieldResult, name: str, one: PlaneField) -> tuple[FieldMap, ...]:
    """A plane's maps; those of best focus belong to the reference plane."""
    if result.focus is not None and name == result.reference:
        return (*one.maps, *result.focus.maps())
    return one.maps


def _provenance(head: RecordHead) -> dict[str, str]:
    entries = head.to_record()
    kept = {name: entries[name] for name in ("procedure", "input", "parameters")}
    return {**{name: json_text({name: value}) for name, value in kept.items()}, "software": json_text(software())}


def _plane_entry(one: PlaneField) -> dict[str, Any]:
    interpolation = one.interpolation
    by_name = {name.name: name for name in one.maps}
    errors: dict[str, float] = {
        name: by_name[name].median(by_name[name].value) for name in (ERROR_NOISE, ERROR_INTERPOLATION)
    }
    return {
        "model": interpolation.field.model.name,
        "components": len(interpolation.field.components),
        "enclosed_share": by_name[ERROR_NOISE].share,
        **errors,
        "budgets": {name: dict(terms) for name, terms in one.budgets.items()},
        "candidates": [asdict(candidate) for candidate in interpolation.candidates[:MAX_CANDIDATES]],
        **{name: asdict(quantity) for name, quantity in one.numbers.items()},
    }


def _colour_entry(colour: LateralColour) -> dict[str, Any]:
    """Record entry of lateral colour: the largest radial shift between the planes."""
    radial, _ = colour.maps()
    if radial.uncertainty is None or not np.isfinite(radial.value).any():
        return {"reference": colour.reference}
    most = np.unravel_index(np.nanargmax(np.abs(radial.value)), radial.value.shape)
    largest = {
        "value": float(radial.value[most]),
        "unit": radial.unit,
        "uncertainty": float(radial.uncertainty[most]),
        "method": "radial shift where it is greatest, from the planes' maps of the charts",
        "n": len(colour.shift),
    }
    return {"reference": colour.reference, "degree": colour.surface.degree, "largest_radial": largest}


def _focus_entry(result: FieldResult) -> dict[str, Any]:
    if result.focus is not None:
        return {"focus": {name: asdict(quantity) for name, quantity in result.focus.numbers().items()}}
    return {"focus_refused": result.focus_refusal} if result.focus_refusal else {}
