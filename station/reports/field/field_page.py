"""The page of a field: maps, the mosaic of PSFs, lateral colour, best focus, vignetting, and how to read the file."""

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from procedures.choice import FREQUENCIES, TERMS, unseen_change
from procedures.field.conclusion import FieldResult, PlaneField
from procedures.field.maps import FieldMap, grid, mesh, mtf50_about, propagated, radius_direction
from procedures.field.photosite import Photosite
from procedures.numbers import ERROR_INTERPOLATION, ERROR_NOISE, MTF50_MERIDIONAL, MTF50_SAGITTAL, OF_PLACES, label
from procedures.outcome import Quantity
from procedures.psf import Psf
from procedures.quality import mtf_along
from station.calibration.field import shared_uncertainties
from station.drawing.plots import Figure
from station.reports.explore import ExploredPlace, ExploredPlaces
from station.reports.field import field_figures
from station.reports.field.camera_section import camera_section, light_figures
from station.reports.field.field_files import FieldParts, mm_per_pixel
from station.reports.field.height_curves import HEIGHTS, WITHOUT_PHOTOSITE, heights_figure
from station.reports.otf_figures import FrequencyAxis
from station.reports.page import (
    Block,
    Figures,
    KeyNumbers,
    Section,
    Table,
    html,
    number_rows,
    percent,
    reason_words,
    sentence,
    tag,
)
from station.reports.report import Report
from station.reports.report_page import report_page
from station.results.plane_result import PlaneResult
from station.results.units import Unit

COLUMNS = 7
POINTS = 41
DIRECTIONS = {"horizontal": 0.0, "vertical": math.pi / 2}


def explored_places(one: PlaneField, centre: PlaneResult) -> ExploredPlaces:
    """A grid of places over the frame, with what their uncertainties share with the result at the centre."""
    field = one.interpolation.field
    known = shared_uncertainties(field, centre)
    shared = np.array([known[name] / centre.factor for name in OF_PLACES])
    points = mesh(*grid(field.shape, COLUMNS))
    enclosed, parameters = field.inside(points), field.parameters(points)
    spots = [_spot(one, shared, *place) for place in zip(points, enclosed, parameters, strict=True)]
    return ExploredPlaces(field.shape, spots)


def _spot(
    one: PlaneField, shared: np.ndarray, place: np.ndarray, enclosed: bool, parameters: np.ndarray
) -> ExploredPlace:
    field, (x, y) = one.interpolation.field, map(float, place)
    noise, interpolation = field.covariances(x, y)
    psf = Psf.of(parameters, noise + interpolation, field.k, field.s, interpolation)
    only_noise = Psf.of(parameters, noise, field.k, field.s, interpolation)
    radius = radius_direction(field.shape, x, y)
    (values, total), (_, by_noise) = mtf50_about(psf, radius), mtf50_about(only_noise, radius)
    rest = np.sqrt(np.maximum(total**2 - by_noise**2, 0))
    total = np.hypot(total, shared)
    numbers = {str(name): Quantity(v, name.unit, u, "", 0) for name, v, u in zip(OF_PLACES, values, total, strict=True)}
    budgets = {
        str(name): {
            "noise and truncation": float(a),
            "interpolation between the charts": float(b),
            "common to all places": float(c),
        }
        for name, a, b, c in zip(OF_PLACES, by_noise, rest, shared, strict=True)
    }
    frequencies = np.linspace(0, min(field.s / 2, 1.0), POINTS)
    relative = unseen_change(one.quality, frequencies)
    curves = {"frequency": frequencies}
    for name, angle in DIRECTIONS.items():
        curves[name], slopes = mtf_along(psf, frequencies, angle)
        curves[f"{name}_uncertainty"] = np.hypot(propagated(psf, slopes), curves[name] * relative)
    return ExploredPlace(x, y, bool(enclosed), numbers, budgets, curves, psf.h, psf.s)


READER = """\
import h5py, numpy as np
with h5py.File("field.h5") as file:
    field, x, y = file["PLANE/anywhere"], X, Y
    i, j = np.argmin(abs(field["y"][:] - y)), np.argmin(abs(field["x"][:] - x))
    psf = field["base"][:] + np.tensordot(field["coefficients"][i, j], field["components"][:], axes=1)
"""
"""Five lines that read the PSF at (X, Y) of a plane."""
MAX_CANDIDATES = 7
FULL_SHARE = 0.995
"""Share of the frame from which a map is said to cover it."""
SUMMARY = (
    "Every chart in every photograph gives the point spread function of its place. Between them it is interpolated by "
    "the model that predicts excluded charts best; each value below includes the error of both."
)


def field_page(report: Report) -> str:
    """The page; curves of other fields are drawn over these if they are in the same units."""
    whole: FieldParts = report.result
    result, lights, camera = whole.result, whole.lights, whole.camera
    colours = result.colours
    figures = []
    for i, colour in enumerate(colours):
        captions = ("Along the radius, outwards positive.", "Across it, clockwise as seen positive.")
        figures.append(field_figures.colour_figure(colour, f"colour{i}"))
        figures += [
            field_figures.field_map_figure(m, colour.positions, colour.shape, f"colour{i}-{m.name}", caption)
            for m, caption in zip(colour.maps(), captions, strict=True)
        ]
    words = "Position of the charts in a plane, less that in {}, in pixels of the sensor: from the maps of the charts."
    text = words.format(colours[0].reference) if colours else ""
    rows = [[miss.source, miss.plane, miss.place, reason_words(miss)] for miss in result.measured.misses]
    table = Table(rows, ["photograph", "plane", "chart at", "why, and what helps"], "wwwr")
    closing = [
        *([Section("Lateral colour", [text, Figures(figures, wide=True)])] if colours else []),
        *_focus_section(result),
        *([Section("Vignetting", [Figures(light_figures(lights), wide=True)])] if lights else []),
        *([camera_section(camera)] if camera and whole.fitted else []),
        *([Section("Charts without a PSF", [table])] if rows else []),
        *_file_section(whole.fitted),
    ]
    blocks = partial(_plane_blocks, whole, report)
    centres = {plane.name: plane for plane in report.planes}
    spots = {name: explored_places(one, centres[name]) for name, one in whole.fitted.items()}
    return report_page(report, summary=_summary(whole), plane_blocks=blocks, closing=closing, spots=spots)


def _summary(whole: FieldParts) -> list[Block]:
    blocks: list[Block] = [SUMMARY]
    if whole.fitted:
        name = whole.result.reference if whole.result.reference in whole.fitted else next(iter(whole.fitted))
        one = whole.fitted[name]
        errors = {m.name: m.median(m.value) for m in one.maps if m.uncertainty is None}
        words = (
            (str(len(one.interpolation.field.nodes)), f"nodes in {name}"),
            (percent(errors[ERROR_NOISE]), "error of the PSF from noise, median over the field"),
            (percent(errors[ERROR_INTERPOLATION]), "error from interpolation, median over the field"),
        )
        blocks.append(KeyNumbers(words))
    rows = [
        [html('<a href="{}">{}</a>', one.look, name) if one.look else name, tag(one.verdict),
         f"{sentence(one.used)} {reason_words(one)}".strip()]
        for name, one in whole.beside.items()
    ]  # fmt: skip
    return [*blocks, *([Table(rows, ["beside the PSF", "measurement", "why"], "wwr")] if rows else [])]


def _plane_blocks(whole: FieldParts, report: Report, plane: PlaneResult) -> list[Block]:
    one, photosite, name = whole.fitted.get(plane.name), whole.result.photosite, plane.name
    if one is None:
        return []
    curves = {stem: by_plane[name] for stem, by_plane in whole.heights.items() if name in by_plane}
    mm = mm_per_pixel(whole.result, name, report.parameters)
    field = one.interpolation.field
    frame = field.positions, field.shape
    leading = [field_figures.mosaic_figure(field, f"{name}-mosaic"),
               field_figures.places_figure(field, one.interpolation.axis, f"{name}-places")]  # fmt: skip
    figures = []
    axis = FrequencyAxis(str(plane.unit), plane.factor)
    if heights := curves.get(HEIGHTS):
        columns = {other.name: other.of(name, plane.unit, "mm" if mm else "pixel") for other in report.overlays}
        figures.append(heights_figure(heights, f"{name}-heights", axis, mm, columns))
    if photosite is not None and (before := curves.get(WITHOUT_PHOTOSITE)):
        caption = f"The same without the photosite: {_division(photosite)} The bands include the fill factor’s error."
        figures.append(heights_figure(before, f"{name}-heights-before", axis, mm, caption=caption))
    figures += [
        field_figures.field_map_figure(
            in_unit(m, plane), *frame, f"{name}-{m.name}", _map_caption(m, photosite), mm_per_pixel=mm
        )
        for m in one.maps
        if m.uncertainty is not None
    ]
    figures.append(
        field_figures.errors_figure([m for m in one.maps if m.uncertainty is None], *frame, f"{name}-errors", mm)
    )
    return [
        Figures(leading, wide=True, summary=True),
        Figures(figures, wide=True),
        Figures(_tables(plane, one), wide=True),
    ]


def _map_caption(one: FieldMap, photosite: Photosite | None) -> str:
    caption = one.title
    if one.share < FULL_SHARE:
        caption += (
            f"; dotted: enclosed by the charts, {percent(one.share)} of the frame. Beyond it the uncertainty grows"
        )
    caption += "."
    if one.name in (MTF50_SAGITTAL, MTF50_MERIDIONAL):
        remedy = "below it is removed" if photosite else "--without-photosite removes it"
        caption += (
            " A square photosite alone passes up to 4 % higher frequencies along its diagonals than along rows and "
            f"columns: a faint cross about the centre is the sensor’s, not the lens’s ({remedy})."
        )
    if one.name.endswith(WITHOUT_PHOTOSITE) and photosite is not None:
        caption += f" Not the camera’s: {_division(photosite)}"
    return caption


def _division(photosite: Photosite) -> str:
    source = "assumed, not measured" if photosite.assumed else "as given"
    return (
        f"its MTF, divided by that of a square photosite of fill factor {photosite.fill:g} ± {photosite.uncertainty:g} "
        f"({source}), which leaves lens, filters and diffusion in the sensor."
    )


def _tables(plane: PlaneResult, field: PlaneField) -> list[Figure]:
    rows = [
        [f"{candidate.name}, {candidate.components}", f"{candidate.error:.3f}"]
        for candidate in field.interpolation.candidates[:MAX_CANDIDATES]
    ]
    candidates = Table(rows, ["model, components", "error at excluded nodes"], style="plain")
    caption = (
        "The best models of interpolation; the first is used. Mean square in units of the noise: 1 would be the noise "
        "of the nodes alone."
    )
    figures = [Figure(candidates, caption)]
    budget = []
    for name, terms in field.budgets.items():
        factor = plane.factor if name.startswith(FREQUENCIES) else 1.0
        sizes = sorted(((factor * size, TERMS[term]) for term, size in terms.items()), reverse=True)
        terms_in_words = "; ".join(f"{words} {size:.2g}" for size, words in sizes if size > 0.01 * sizes[0][0])
        budget.append([label(name), terms_in_words])
    if budget:
        caption = "Standard uncertainty at one chart by source, rms over the charts; below 1 % of the largest omitted."
        figures.append(Figure(Table(budget, columns="wr", style="plain"), caption))
    return figures


def in_unit(one: FieldMap, record: PlaneResult) -> FieldMap:
    """A map with its frequencies in the unit of a plane's result."""
    if one.unit != Unit.CYCLES or one.uncertainty is None:
        return one
    factor = record.factor
    return replace(one, value=one.value * factor, uncertainty=one.uncertainty * factor, unit=str(record.unit))


def _focus_section(result: FieldResult) -> list[Section]:
    if (surface := result.focus) is None:
        return [Section("Best focus", [sentence(result.focus_refusal)])] if result.focus_refusal else []
    maps = [
        field_figures.field_map_figure(m, surface.positions, surface.shape, f"focus-{m.name}", m.title)
        for m in surface.maps()
    ]
    numbers = number_rows(surface.numbers(), methods=True)
    table = Figure(numbers, "A quadratic surface through the best focus at every chart.")
    return [Section("Best focus", [Figures([*maps, table], wide=True)])]


def _file_section(fitted: Mapping[str, PlaneField]) -> list[Section]:
    """The file, and the five lines that read it, for a place in the middle of a plane."""
    if not fitted:
        return []
    name, one = next(iter(fitted.items()))
    place = f"{one.maps[0].x[-1] / 2:.1f}, {one.maps[0].y[-1] / 2:.1f}"
    code = html("<pre class='card'><code>{}</code></pre>", READER.replace("PLANE", name).replace("X, Y", place))
    words = "`field.h5` holds nodes, covariances, maps, units and conventions. Five lines give the PSF at a place:"
    return [Section("The file", [words, code])]
