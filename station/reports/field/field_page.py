"""The page of a field: what was measured, one picture per map, the mosaic of PSFs, and how to read the file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from procedures.budget import FREQUENCIES, TERMS
from procedures.field.conclusion import FieldResult, PlaneField
from procedures.field.image_height import HeightCurve
from procedures.field.maps import FieldMap
from procedures.outcome import Verdict
from procedures.vignetting.formula import LightSurface
from procedures.whole_camera.from_field import WholeCamera
from station.reports.field import field_figures
from station.reports.field.camera_section import camera_section, light_figures
from station.reports.field.height_curves import HEIGHTS, WITHOUT_PHOTOSITE, heights_figure
from station.reports.otf_figures import FrequencyAxis
from station.reports.page import render
from station.results.overlay import HeightOverlay
from station.results.plane_result import PlaneResult
from station.results.record_head import PartBeside, RecordHead
from station.results.terms import specification_verdict
from station.results.units import Unit, told_quantity

READER = """\
import h5py, numpy as np
with h5py.File("field.h5") as file:
    field, x, y = file["PLANE/anywhere"], X, Y
    i, j = np.argmin(abs(field["y"][:] - y)), np.argmin(abs(field["x"][:] - x))
    psf = field["base"][:] + np.tensordot(field["coefficients"][i, j], field["components"][:], axes=1)
"""
"""Five lines that read the PSF at (X, Y) of a plane."""


PAIRS = "grid-template-columns: repeat(auto-fit, minmax(min(100%, 480px), 1fr))"
"""Figures of two panels need more than a third of the page each."""


def field_page(
    found: FieldResult,
    results: Sequence[PlaneResult],
    head: RecordHead,
    software: Mapping[str, Any],
    heights: Mapping[str, Mapping[str, Sequence[HeightCurve]]],
    overlays: Sequence[HeightOverlay] = (),
    lights: Mapping[str, LightSurface] | None = None,
    camera: WholeCamera | None = None,
    beside: Mapping[str, PartBeside] | None = None,
) -> str:
    """The page; `results` are the planes' answers at the frame's centre, in the terms that were asked for.

    heights : by the stem of its table's name and by plane, the MTF over image height
    overlays : other fields, whose MTF is drawn over these where they tell it in the same units
    lights : by plane, its vignetting, where that was measured
    camera : all else that the charts tell, where that was asked for
    beside : by name, the results of other parts of the same session
    """
    judged = specification_verdict(results)
    verdicts = [one.verdict for one in results]
    worst = next(v for v in (Verdict.REFUSED, Verdict.DOUBTFUL, Verdict.PASS) if v in verdicts)
    fitted = [(one, field) for one in results if (field := found.planes[one.name].value) is not None]
    return render(
        "field.html",
        found=found,
        results=results,
        judged=judged and str(judged),
        head=head,
        worst=worst,
        planes=[
            _plane(
                *one,
                {stem: curves[one[0].name] for stem, curves in heights.items() if one[0].name in curves},
                mm_per_pixel(found, one[0].name, head.parameters),
                overlays,
            )
            for one in fitted
        ],
        shown=next((i for i, (one, _) in enumerate(fitted) if one.name == found.reference), 0),
        pairs=PAIRS,
        refused=[one for one in results if one.psf is None],
        colours=[_colour(colour, i) for i, colour in enumerate(found.colours)],
        focus=_focus(found),
        lights=light_figures(lights or {}),
        camera=camera and camera_section(camera),
        beside=beside or {},
        reader=_reader(*fitted[0]) if fitted else "",
        software=software,
    )


def _reader(record: PlaneResult, one: PlaneField) -> str:
    """The five lines, for a place in the middle of a plane."""
    rows, columns = one.maps[0].y[-1], one.maps[0].x[-1]
    return READER.replace("PLANE", record.name).replace("X, Y", f"{columns / 2:.1f}, {rows / 2:.1f}")


def mm_per_pixel(found: FieldResult, plane: str, parameters: Mapping[str, Any]) -> float | None:
    """The pitch of a plane's pixels in mm, as it was given or the camera noted it; None where it is not known."""
    given = parameters.get("pixel_pitch_um")
    known = given or next((one.exposure.pixel_pitch_um for one in found.measured.exposures), None)
    return None if not known else found.measured.planes[plane].pitch * float(known) / 1000


def _plane(
    record: PlaneResult,
    one: PlaneField,
    heights: Mapping[str, Sequence[HeightCurve]],
    mm: float | None,
    overlays: Sequence[HeightOverlay],
) -> dict[str, Any]:
    """What the template shows of a plane; mm : of its pixels."""
    curves, before = heights.get(HEIGHTS, ()), heights.get(WITHOUT_PHOTOSITE, ())
    found, name = one.interpolation, record.name
    field = found.field
    frame = field.positions, field.shape
    drawn = [in_unit(m, record) for m in one.maps if m.uncertainty is not None]
    errors = [m for m in one.maps if m.uncertainty is None]
    pictures = [(m, m.share, field_figures.field_map_figure(m, *frame, f"{name}-{m.name}", mm)) for m in drawn]
    axis = FrequencyAxis(str(record.unit), record.factor)
    others = {other.name: other.of(name, "mm" if mm else "pixel") for other in overlays}
    drawn_over = {other: columns for other, columns in others.items() if columns}
    return {
        "record": record,
        "found": found,
        "numbers": {key: told_quantity(number, record.unit, record.factor) for key, number in one.numbers.items()},
        "budgets": _budgets(record, one),
        "error": _medians(one),
        "maps": pictures,
        "errors": field_figures.errors_figure(errors, *frame, f"{name}-errors", mm),
        "heights": heights_figure(curves, f"{name}-heights", axis, mm, drawn_over) if curves else None,
        "heights_before": heights_figure(before, f"{name}-heights-before", axis, mm) if before else None,
        "others": list(drawn_over),
        "not_drawn": [other for other in others if other not in drawn_over],
        "directions": max((int(one.directions.max()) for one in curves), default=0),
        "mosaic": field_figures.mosaic_figure(field, f"{name}-mosaic"),
        "places": field_figures.places_figure(field, found.axis, f"{name}-places"),
    }


def _budgets(record: PlaneResult, one: PlaneField) -> dict[str, list[tuple[str, str]]]:
    """By number the terms of its uncertainty at one chart, the largest first, in the unit of the plane's result."""
    told = {}
    for name, terms in one.budgets.items():
        factor = record.factor if name.startswith(FREQUENCIES) else 1.0
        sizes = sorted(((factor * size, TERMS[term]) for term, size in terms.items()), reverse=True)
        told[name] = [(f"{size:.2g}", words) for size, words in sizes]
    return told


def in_unit(one: FieldMap, record: PlaneResult) -> FieldMap:
    """A map with its frequencies in the unit of a plane's result."""
    if one.unit != Unit.CYCLES or one.uncertainty is None:
        return one
    factor = record.factor
    return replace(one, value=one.value * factor, uncertainty=one.uncertainty * factor, unit=str(record.unit))


def _medians(one: PlaneField) -> dict[str, float]:
    return {m.name: m.median(m.value) for m in one.maps if m.uncertainty is None}


def _colour(colour: Any, number: int) -> dict[str, Any]:
    maps = [
        field_figures.field_map_figure(m, colour.positions, colour.shape, f"colour{number}-{m.name}")
        for m in colour.maps()
    ]
    return {"colour": colour, "arrows": field_figures.colour_figure(colour, f"colour{number}"), "maps": maps}


def _focus(found: FieldResult) -> dict[str, Any] | None:
    surface = found.focus
    if surface is None:
        return None
    maps = [
        field_figures.field_map_figure(m, surface.positions, surface.shape, f"focus-{m.name}") for m in surface.maps()
    ]
    return {"numbers": surface.numbers(), "maps": maps}
