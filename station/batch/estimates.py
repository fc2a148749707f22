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
from procedures.raw import read_photograph
from procedures.reading.exposure import Exposure
from station.batch.procedure_file import ALL, Procedure
from station.calibration.planes import diffraction_limit
from station.common.sanitise import encodable, printable
from station.common.threads import limited
from station.procedure.base import Inputs
from station.results.measurement import write_measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead
from station.results.result_files import ResultFolder
from station.results.units import Pixels

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
    if procedure.restoration is not None:
        return _restoration(procedure, procedure.restoration, paths, contents)
    return _field(procedure, paths, hashes)


def _measured(procedure: Procedure, paths: Sequence[Path], hashes: Sequence[str]) -> Answer:
    """What a procedure of `station.procedure` measures."""
    measuring = procedure.measuring
    given = [Path(os.path.commonpath(paths))] if measuring.inputs is Inputs.FOLDER else paths
    with limited(1):  # other processes work beside this one
        found = measuring.measure(given, procedure.settings, procedure.terms)
    known = dict(zip(map(str, paths), hashes, strict=True))
    for one in found.head.input:
        if known.get(one.path, one.sha256) != one.sha256:
            raise ChangedMeanwhile(Path(one.path))

    def write(place: ResultFolder, head: RecordHead, page: bool) -> str:
        if page and measuring.draws(found):
            place.write(measuring.page_name, measuring.page(found))
        whole = replace(head, parameters={**found.head.parameters, **procedure.terms.parameters()})
        return write_measurement(place, replace(found, head=whole))

    return Answer(found.planes, found.exposure, write)


def further_files(procedure: Procedure, paths: Sequence[Path]) -> dict[Path, str]:
    """The files that an answer depends on beside its photographs, with their hashes; "" of those that are not there."""
    if procedure.settings is not None:
        return {one: hash_of(one) for one in procedure.measuring.files(paths, procedure.settings)}
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

    optics: dict[str, Any] = {"pixel_pitch_um": None, **procedure.optics}
    parameters = cast(PatternParameters, procedure.parameters)
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
