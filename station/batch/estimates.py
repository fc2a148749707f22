"""What each procedure makes of an item's photographs: its planes' results, and how they are written."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from procedures.outcome import BadInput
from procedures.pattern_psf.estimate import PatternParameters
from procedures.raw import RawFrame, default_plane, read_frame, read_photograph
from procedures.reading.exposure import Exposure, check_typed
from procedures.two_photo.estimate import TwoPhotoParameters
from station.batch.procedure_file import ALL, EDGE, FIELD, TWO_PHOTO, Procedure
from station.calibration.planes import calibrate, calibrate_pair, diffraction_limit
from station.common.sanitise import encodable, printable
from station.procedure.base import Inputs
from station.procedure.registry import procedure_named
from station.results.measurement import write_measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead
from station.results.result_files import ResultFolder, write_psf_result
from station.results.units import Pixels, pixels_of

if TYPE_CHECKING:
    from station.calibration.restoration.restorations import RestorationOptions

Write = Callable[[ResultFolder, RecordHead, bool], str]
"""Writes all files into a folder; is told what the record says beside its planes, and whether a page is wanted."""


@dataclass(frozen=True, eq=False)
class Answer:
    """What became of an item: its planes' results, what the camera noted of it, and how it is written."""

    planes: Sequence[PlaneResult]
    exposure: Exposure
    write: Write


class ChangedMeanwhile(Exception):
    """A file that is no longer what an item's hashes tell."""

    def __init__(self, path: Path) -> None:
        super().__init__(f"{printable(path)} was changed while the batch read it")


def estimate(
    procedure: Procedure, paths: Sequence[Path], contents: Sequence[bytes], hashes: Sequence[str] = ()
) -> Answer:
    """The answer of a procedure; `contents` are the files', which a field reads by itself and holds to their hashes.

    Raises
    ------
    ProcedureError
        As the procedures do.
    ChangedMeanwhile
        If a file is no longer of its hash.
    """
    if procedure.settings is not None:
        return _measured(procedure, paths, hashes)
    if procedure.name == FIELD:
        return _field(procedure, paths, hashes)
    if procedure.restoration is not None:
        return _restoration(procedure, procedure.restoration, paths, contents)
    frames = [_read(*file, procedure) for file in zip(paths, contents, strict=True)]
    return _edges(procedure, frames[0]) if procedure.name == EDGE else _psf(procedure, frames)


def _measured(procedure: Procedure, paths: Sequence[Path], hashes: Sequence[str]) -> Answer:
    """What a procedure of `station.procedure` measures."""
    measuring = procedure_named(procedure.name)
    given = [Path(os.path.commonpath(paths))] if measuring.inputs is Inputs.FOLDER else paths
    found = measuring.measure(given, procedure.settings, procedure.terms)
    known = dict(zip(map(str, paths), hashes, strict=True))
    for one in found.head.input:
        if known.get(one.path, one.sha256) != one.sha256:
            raise ChangedMeanwhile(Path(one.path))

    def write(place: ResultFolder, head: RecordHead, page: bool) -> str:
        if page and measuring.has_page and not found.refused:
            place.write(measuring.page_name, measuring.page(found))
        return write_measurement(place, replace(found, head=head))

    return Answer(found.planes, found.exposure, write)


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
    limit = partial(diffraction_limit, frames[0].exposure, needed=procedure.physics, **optics)
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
    """The slanted edges of a photograph."""
    from station.calibration.edges import measure_edges, write_edge_result

    optics = _optics(procedure)
    limit = partial(diffraction_limit, frame.exposure, **optics)
    records = list(measure_edges(frame, None, limit, procedure.terms, optics["pixel_pitch_um"]))

    def write(place: ResultFolder, head: RecordHead, page: bool) -> str:
        if page:
            from station.reports.edges.edge_page import edge_page, edge_report  # here: it draws, which is slow to load

            told = edge_report(frame, records, procedure.told(), procedure.terms)
            place.write("report.html", edge_page(told, frame, records).encode())
        return write_edge_result(place, frame, records, head)

    return Answer([one.result for one in records], frame.exposure, write)


def further_files(procedure: Procedure, paths: Sequence[Path]) -> dict[Path, str]:
    """The files that an answer depends on beside its photographs, with their hashes; "" of those that are not there."""
    if procedure.settings is not None:
        return {one: hash_of(one) for one in procedure_named(procedure.name).files(paths, procedure.settings)}
    options = procedure.restoration
    return {} if options is None else {one: hash_of(one) for one in options.placed(procedure.folder, paths).files}


def hash_of(path: Path) -> str:
    """Of a file; "" where it cannot be read, which those who read it tell by name."""
    try:
        return hashlib.sha256(read_photograph(path)).hexdigest()
    except BadInput:
        return ""


def _as_hashed(paths: Sequence[Path], hashes: Sequence[str]) -> Callable[[Path], bytes]:
    """Reads files that must be of their hashes: what is decoded is what the row tells. Raises ChangedMeanwhile."""
    known = dict(zip(paths, hashes, strict=True))

    def content(path: Path) -> bytes:
        data = read_photograph(path)
        if hashlib.sha256(data).hexdigest() != known[path]:
            raise ChangedMeanwhile(path)
        return data

    return content


def _restoration(
    procedure: Procedure, options: RestorationOptions, paths: Sequence[Path], contents: Sequence[bytes]
) -> Answer:
    """Picture and depth of photographs of one scene, as `station restore` finds them."""
    from station.calibration.restoration.restorations import (  # here: they load what restores
        read_ground_truth,
        read_photographs,
        restored,
    )
    from station.reports.restoration_files import restoration_result, write_outcome

    before, chosen = further_files(procedure, paths), options.placed(procedure.folder, paths)
    plane = procedure.planes[0] if procedure.planes else None
    chosen = chosen.checked(len(paths))
    frames, photographs = read_photographs(paths, plane, procedure.layout, options.encoding, contents)
    truth = None
    if chosen.reference is not None:
        truth = read_ground_truth(Path(chosen.reference), frames, procedure.layout, options.encoding)
    found = restored(chosen, frames, photographs, truth=truth)
    for path, known in further_files(procedure, paths).items():
        if before.get(path) != known:
            raise ChangedMeanwhile(path)

    def write(place: ResultFolder, head: RecordHead, page: bool) -> str:
        files = [{"path": encodable(str(path)), "sha256": known} for path, known in before.items()]
        whole = replace(head, parameters={**head.parameters, **found.parameters, "files": files})
        return write_outcome(place, found, whole, photographs, page=page)

    return Answer([restoration_result(found.outcome, frames)], frames[0].exposure, write)


def _field(procedure: Procedure, paths: Sequence[Path], hashes: Sequence[str]) -> Answer:
    """The field of a folder's photographs."""
    from procedures.field.conclusion import conclude
    from procedures.field.measuring import measure
    from station.calibration.field import field_pixels, field_results
    from station.calibration.field_photographs import check_noted
    from station.reports.field.field_files import write_field

    optics, parameters = _optics(procedure), cast(PatternParameters, procedure.parameters)
    if not procedure.trust_typed:
        check_noted(paths, optics, "write trust_typed = true")
    names = None if not procedure.planes or ALL in procedure.planes else list(procedure.planes)
    content = _as_hashed(paths, hashes)
    measured = measure(paths, names, procedure.chart_source.chart, parameters, layout=procedure.layout, content=content)
    exposure = measured.exposures[0].exposure if measured.exposures else Exposure()
    limit = partial(diffraction_limit, exposure, **optics)
    pixels = field_pixels(measured, optics["pixel_pitch_um"])
    at = procedure.terms.frequencies(next(iter(pixels.values()), Pixels()))
    found = conclude(measured, limit=limit, at=at)
    planes = field_results(found, procedure.terms, pixels, limit)

    def write(place: ResultFolder, head: RecordHead, page: bool) -> str:
        return write_field(place, found, planes, head, report=page)

    return Answer(planes, exposure, write)
