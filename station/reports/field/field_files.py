"""The files of a field's result: the record, the PSF at the frame's centre, `field.h5` and the page."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from procedures.field import field_file
from procedures.field.chromatic import LateralColour
from procedures.field.conclusion import FieldResult, PlaneField
from procedures.field.image_height import HeightCurve, over_height
from procedures.field.maps import FieldMap
from procedures.field.photosite import Photosite, WithoutPhotosite
from procedures.numbers import CORNER_LIGHT, DARKEST_CORNER, ERROR_INTERPOLATION, ERROR_NOISE
from procedures.vignetting.formula import LightSurface
from procedures.whole_camera.camera_file import write_camera_numbers
from procedures.whole_camera.from_field import WholeCamera
from station.calibration.camera_notes import exposure_of
from station.common.versions import software
from station.reports.certificate_print import write_certificate
from station.reports.field.field_page import field_page, mm_per_pixel
from station.reports.field.height_curves import FREQUENCIES, HEIGHTS, WITHOUT_PHOTOSITE, heights_table
from station.reports.otf_figures import FrequencyAxis
from station.reports.report import Report, report_of_files
from station.results.overlay import HeightOverlay
from station.results.plane_result import PlaneResult
from station.results.psf_files import write_psf_result
from station.results.record_head import InputFile, PartBeside, RecordHead, verdict_entry
from station.results.result_files import ResultFolder, json_text
from station.results.terms import Terms
from station.results.units import told_quantity

FILE, CAMERA, PAGE = "field.h5", "camera.h5", "report.html"
CANDIDATES_TOLD = 8


def write_field_result(
    folder: ResultFolder,
    found: FieldResult,
    planes: Sequence[PlaneResult],
    terms: Terms,
    *,
    parameters: Mapping[str, Any],
    start: float,
    report: bool = True,
    certificate: bool = False,
    lights: Mapping[str, LightSurface] | None = None,
    overlays: Sequence[HeightOverlay] = (),
    camera: WholeCamera | None = None,
) -> str:
    """Write all files, page and certificate where they are wanted; returns the record's text.

    `planes` are the answers at the frame's centre, in the terms that were asked for; `lights` is the lens's vignetting,
    where it was measured; `overlays` are other fields, drawn over the page's curves; `camera` is all that the
    photographs tell beside the PSF.
    """
    files = tuple(InputFile(str(path), sha256) for path, sha256 in found.measured.frames)
    head = RecordHead("field", files, {**parameters, **terms.parameters()}, terms.specified(planes))
    if certificate:
        write_certificate(folder, field_report(found, planes, head.parameters, terms))
    return write_field(
        folder, found, planes, head, start, report=report, lights=lights, overlays=overlays, camera=camera
    )


def field_report(
    found: FieldResult, planes: Sequence[PlaneResult], parameters: Mapping[str, object], terms: Terms
) -> Report:
    """What a field's certificate tells: the frame's centre, and the medians over the frame."""
    told = [with_medians(one, found) for one in planes]
    return report_of_files("field", found.measured.exposures, told, parameters, terms.specification)


def with_medians(one: PlaneResult, found: FieldResult) -> PlaneResult:
    """A plane's result with the medians of its maps among the numbers, in its unit."""
    outcome = found.planes.get(one.name)
    if outcome is None or outcome.value is None:
        return one
    medians = {name: told_quantity(number, one.unit, one.factor) for name, number in outcome.value.numbers.items()}
    return replace(one, numbers={**one.numbers, **medians})


def write_planes(
    folder: ResultFolder,
    planes: Sequence[PlaneResult],
    head: RecordHead,
    camera: WholeCamera | None = None,
    *,
    lights: Mapping[str, LightSurface] | None = None,
    beside: Mapping[str, PartBeside] | None = None,
) -> str:
    """The same files of planes that have found a field, all the same one; the record of its refusal where none has.

    `beside` are the results of other parts of the same session, which record and page tell of.
    """
    found = next((one.found for one in planes if one.found is not None), None)
    if found is None:
        return write_psf_result(folder, planes, head)
    return write_field(folder, found, planes, head, camera=camera, lights=lights, beside=beside)


def write_field(
    folder: ResultFolder,
    found: FieldResult,
    planes: Sequence[PlaneResult],
    head: RecordHead,
    start: float | None = None,
    *,
    report: bool = True,
    lights: Mapping[str, LightSurface] | None = None,
    overlays: Sequence[HeightOverlay] = (),
    camera: WholeCamera | None = None,
    beside: Mapping[str, PartBeside] | None = None,
) -> str:
    """All files; `start` tells when it began, where that is to be told; `overlays` are drawn over the page's curves."""
    measured = found.measured
    fitted = {name: one.value for name, one in found.planes.items() if one.value is not None}
    entry = {
        "file": FILE,
        "frames": len(measured.frames),
        "failed": measured.failed,
        "misses": [asdict(miss) for miss in measured.misses],
        "doubtful_nodes": sum(bool(node.doubt) for nodes in measured.nodes.values() for node in nodes),
        "planes": {name: _told(one) for name, one in fitted.items()},
        "lateral_colour": {colour.plane: _colour_told(colour) for colour in found.colours},
        **_focus_told(found),
    }
    if fitted and lights:
        entry["vignetting"] = {name: _light_told(one) for name, one in lights.items()}
    if fitted and camera is not None:
        entry["camera"] = _camera_told(camera)
    if beside:
        entry["parts"] = {name: asdict(one) for name, one in beside.items()}
    head = replace(head, field=entry)
    if fitted:
        fields = {name: one.interpolation for name, one in fitted.items()}
        maps = {name: _maps(found, name, one) for name, one in fitted.items()}
        noted = exposure_of(measured.exposures)
        field_file.write_field(folder.staging / FILE, fields, maps, found.colours, _provenance(head), noted)
        if lights:
            field_file.add_lights(folder.staging / FILE, lights)
        if camera is not None:
            write_camera_numbers(folder.staging / CAMERA, camera, _provenance(head))
    if start is not None:
        head = replace(head, duration_s=round(time.perf_counter() - start, 3))
    heights = {stem: _heights(found, without) for stem, without in tables_of(found.photosite).items()}
    for one in planes:
        axis, mm = FrequencyAxis(str(one.unit), one.factor), mm_per_pixel(found, one.name, head.parameters)
        for stem, curves in heights.items():
            if one.name in curves:
                folder.write(f"{stem}_{one.name}.csv", heights_table(curves[one.name], axis, mm))
    if report:
        page = field_page(
            found, planes, head, software(), heights, overlays, lights, camera if fitted else None, beside
        )
        folder.write(PAGE, page.encode())
    return write_psf_result(folder, planes, head)


def tables_of(photosite: Photosite | None) -> dict[str, Photosite | None]:
    """The tables of the MTF over image height by the stems of their names, and what each is told without."""
    return {HEIGHTS: None} | ({WITHOUT_PHOTOSITE: photosite} if photosite else {})


def _heights(found: FieldResult, photosite: Photosite | None) -> dict[str, list[HeightCurve]]:
    """Every plane's MTF over image height, of those that have a field around the frame's centre."""
    curves = {}
    for name, one in found.planes.items():
        if one.value is not None:
            without = WithoutPhotosite(photosite, one.value.pitch) if photosite else None
            curves[name] = over_height(one.value.interpolation.field, FREQUENCIES, without)
    return {name: one for name, one in curves.items() if one}


def _camera_told(camera: WholeCamera) -> dict[str, Any]:
    """What the record says of all that the charts tell: the file, and the geometry in figures."""
    geometry, numbers = camera.geometry, camera.numbers
    told = verdict_entry(geometry)
    if geometry.value is not None:
        found = {name: asdict(number) for name, number in geometry.value.numbers().items()}
        told = {**told, "model": geometry.value.camera.model, **found}
    return {"file": CAMERA, "numbers": len(numbers.values), "parts": [part.name for part in numbers.parts],
            "geometry": told}  # fmt: skip


def _light_told(light: LightSurface) -> dict[str, Any]:
    """What the record says of a plane's vignetting."""
    rows, columns = light.shape
    corners = np.array([(x, y) for x in (0, columns - 1) for y in (0, rows - 1)], dtype=np.float64)
    return {CORNER_LIGHT: float(light.at(corners).mean()), DARKEST_CORNER: float(light.at(corners).min())}


def _maps(found: FieldResult, name: str, one: PlaneField) -> tuple[FieldMap, ...]:
    """A plane's maps; those of best focus belong to the reference plane."""
    if found.focus is not None and name == found.reference:
        return (*one.maps, *found.focus.maps())
    return one.maps


def _provenance(head: RecordHead) -> dict[str, str]:
    """Texts for the file's attributes."""
    told = head.told()
    kept = {name: told[name] for name in ("procedure", "input", "parameters")}
    return {**{name: json_text({name: value}) for name, value in kept.items()}, "software": json_text(software())}


def _told(one: PlaneField) -> dict[str, Any]:
    """What the record says about a plane's field."""
    found = one.interpolation
    by_name = {name.name: name for name in one.maps}
    errors: dict[str, float] = {
        name: by_name[name].median(by_name[name].value) for name in (ERROR_NOISE, ERROR_INTERPOLATION)
    }
    return {
        "model": found.field.model.name,
        "components": len(found.field.components),
        "enclosed_share": by_name[ERROR_NOISE].share,
        **errors,
        "budgets": {name: dict(terms) for name, terms in one.budgets.items()},
        "candidates": [asdict(candidate) for candidate in found.candidates[:CANDIDATES_TOLD]],
        **{name: asdict(quantity) for name, quantity in one.numbers.items()},
    }


def _colour_told(colour: LateralColour) -> dict[str, Any]:
    """Lateral colour in figures: how far apart the planes are where it is most."""
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


def _focus_told(found: FieldResult) -> dict[str, Any]:
    if found.focus is not None:
        return {"focus": {name: asdict(quantity) for name, quantity in found.focus.numbers().items()}}
    return {"focus_refused": found.focus_refusal} if found.focus_refusal else {}
