"""What each procedure makes of an item's photographs: its planes' results, and how they are written."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, cast

from procedures.pattern_psf.estimate import PatternParameters
from procedures.raw import RawFrame, default_plane, read_frame
from procedures.reading.exposure import Exposure, check_typed
from procedures.two_photo.estimate import TwoPhotoParameters
from station.batch.procedure_file import ALL, EDGE, FIELD, TWO_PHOTO, Procedure
from station.calibration.planes import calibrate, calibrate_pair, diffraction_limit
from station.common.sanitise import printable
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead
from station.results.result_files import ResultFolder, write_psf_result
from station.results.units import Pixels, pixels_of

Write = Callable[[ResultFolder, RecordHead, bool], str]
"""Writes all files into a folder; is told what the record says beside its planes, and whether a page is wanted."""


@dataclass(frozen=True, eq=False)
class Answer:
    """What became of an item: its planes' results, what the camera noted of it, and how it is written."""

    planes: Sequence[PlaneResult]
    exposure: Exposure
    write: Write


def estimate(procedure: Procedure, paths: Sequence[Path], contents: Sequence[bytes]) -> Answer:
    """The answer of a procedure; `contents` are the files', which a field reads by itself. Raises ProcedureError."""
    if procedure.name == FIELD:
        return _field(procedure, paths)
    frames = [_read(*file, procedure) for file in zip(paths, contents, strict=True)]
    return _edges(procedure, frames[0]) if procedure.name == EDGE else _psf(procedure, frames)


def _read(path: Path, data: bytes, procedure: Procedure) -> RawFrame:
    planes, layout = procedure.planes, procedure.layout
    names = None if ALL in planes else list(planes) or [default_plane(path, layout)]
    frame = read_frame(path, names, layout, data=data)
    if not procedure.trust_typed:
        check_typed(frame.exposure, procedure.optics, printable(path), "write trust_typed = true")
    return frame


def _optics(procedure: Procedure) -> dict[str, Any]:
    return {"pixel_pitch_um": None, **procedure.optics}


def _psf(procedure: Procedure, frames: Sequence[RawFrame]) -> Answer:
    """Every plane of a photograph of the chart or of a pair of a wall, one after the other."""
    optics = _optics(procedure)
    limit = partial(diffraction_limit, frames[0].exposure, **optics)
    pixels = pixels_of(frames[0], optics["pixel_pitch_um"])
    at = procedure.terms.frequencies(next(iter(pixels.values())))
    if procedure.name == TWO_PHOTO:
        pair = replace(cast(TwoPhotoParameters, procedure.parameters), at=at)
        found = calibrate_pair(frames[0], frames[1], pair, limit, threads=1)
    else:
        parameters = replace(cast(PatternParameters, procedure.parameters), at=at)
        chart = procedure.chart_source.chart
        found = calibrate(frames[0], chart, parameters, limit, threads=1, physics=procedure.physics)
    planes = [procedure.terms.told(one, pixels[one.name]) for one in found]

    def write(place: ResultFolder, head: RecordHead, page: bool) -> str:
        if page:
            _write_page(place, procedure, frames, planes)
        return write_psf_result(place, planes, head)

    return Answer(planes, frames[0].exposure, write)


def _write_page(
    place: ResultFolder, procedure: Procedure, frames: Sequence[RawFrame], planes: Sequence[PlaneResult]
) -> None:
    from station.reports.pattern_report import (  # here: it draws, and that import is slow
        PAGE,
        calibration_page,
        report_of_files,
    )

    kind = TWO_PHOTO if procedure.name == TWO_PHOTO else "pattern"
    report = report_of_files(kind, frames, planes, procedure.told(), procedure.terms.specification)
    place.write(PAGE, calibration_page(report).encode())


def _edges(procedure: Procedure, frame: RawFrame) -> Answer:
    """The slanted edges of a photograph; it has no page."""
    from station.calibration.edges import measure_edges, write_edge_result

    optics = _optics(procedure)
    limit = partial(diffraction_limit, frame.exposure, **optics)
    records = list(measure_edges(frame, None, limit, procedure.terms, optics["pixel_pitch_um"]))

    def write(place: ResultFolder, head: RecordHead, page: bool) -> str:
        return write_edge_result(place, frame, records, head)

    return Answer([one.result for one in records], frame.exposure, write)


def _field(procedure: Procedure, paths: Sequence[Path]) -> Answer:
    """The field of a folder's photographs."""
    from procedures.field.conclusion import conclude
    from procedures.field.measuring import measure
    from station.calibration.field import field_pixels, field_results
    from station.calibration.field_photographs import check_noted
    from station.reports.field_files import write_field

    optics, parameters = _optics(procedure), cast(PatternParameters, procedure.parameters)
    if not procedure.trust_typed:
        check_noted(paths, optics, "write trust_typed = true")
    names = None if not procedure.planes or ALL in procedure.planes else list(procedure.planes)
    measured = measure(paths, names, procedure.chart_source.chart, parameters, layout=procedure.layout)
    exposure = measured.exposures[0].exposure if measured.exposures else Exposure()
    limit = partial(diffraction_limit, exposure, **optics)
    pixels = field_pixels(measured, optics["pixel_pitch_um"])
    at = procedure.terms.frequencies(next(iter(pixels.values()), Pixels()))
    found = conclude(measured, limit=limit, at=at)
    planes = field_results(found, procedure.terms, pixels, limit)

    def write(place: ResultFolder, head: RecordHead, page: bool) -> str:
        return write_field(place, found, planes, head, report=page)

    return Answer(planes, exposure, write)
