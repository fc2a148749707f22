"""One photograph of a batch, from its file to its folder: the work that processes and clusters share out."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, cast

from procedures.outcome import BadInput, BadParameter, ProcedureError
from procedures.pattern_psf.estimate import PatternParameters
from procedures.raw import RawFrame, default_plane, read_frame, read_photograph
from procedures.reading.exposure import check_typed
from procedures.two_photo.estimate import TwoPhotoParameters
from station.batch.procedure_file import ALL, Procedure
from station.calibration.folder_photographs import Item
from station.calibration.planes import calibrate, calibrate_pair, diffraction_limit
from station.common.sanitise import encodable, printable, safe_stem
from station.results.limits import ORDER, Judgement, all_against, judge, verdict_within
from station.results.plane_result import PlaneResult
from station.results.result_files import RECORD, ResultFolder, software, write_psf_result
from station.results.result_seal import damage

RESULTS = "results"
KEY_LETTERS = 16
"""Letters of an item's hash that its folder's name ends with."""
PASS, DOUBTFUL, FAIL, REFUSED = ORDER
UNREADABLE, LOST, FAULT = "unreadable", "lost", "fault"
VERDICTS = (*ORDER, UNREADABLE, LOST, FAULT)
"""What can come of a photograph, the best first: inside the limits, not surely inside, outside; no PSF from it; no
photograph at all; it ended the process that worked on it; it met an error of this program."""
USABLE = (PASS, DOUBTFUL)
NO_MEMORY = -4
"""Code of an OpenCV error (cv::Error::StsNoMem)."""
MORE_MEMORY = "look at this photograph by itself; if it is meant so, give more --memory-mb, and fewer --jobs"


@dataclass(frozen=True, eq=False)
class Job:
    """What is the same for all items.

    Attributes
    ----------
    out : Path
        The batch's folder.
    done : mapping of key to folder
        What earlier runs have finished.
    reports : bool
        Whether a page is written for each item.
    """

    procedure: Procedure
    out: Path
    done: Mapping[str, str] = field(default_factory=dict)
    reports: bool = False


@dataclass(frozen=True)
class PlaneRow:
    """A plane's cells in the batch's table, no result: what JSON keeps of it, so that a line read back is the same.

    The result itself, with PSF and curves, is in the line's folder.

    Attributes
    ----------
    verdict, reason : by the estimate and the limits
    numbers : by name; value, and where there are such, uncertainty and unit
    limits : the judgements
    """

    verdict: str
    reason: str
    remedy: str
    numbers: Mapping[str, Mapping[str, Any]]
    limits: Sequence[Mapping[str, Any]]


@dataclass(frozen=True)
class Row:
    """What became of an item, in one line.

    Attributes
    ----------
    files, sha256 : sequence of str
    verdict : one of VERDICTS
        The worst of its planes.
    folder : str
        Of its result, from the batch's folder; "" where none was kept, so that a later run tries again.
    reused : bool
        Whether an earlier run has done it.
    redone : str
        Why it was done again though an earlier run had, "" where none had.
    """

    files: Sequence[str]
    verdict: str
    reason: str = ""
    remedy: str = ""
    sha256: Sequence[str] = ()
    folder: str = ""
    planes: Mapping[str, PlaneRow] = field(default_factory=dict)
    reused: bool = False
    duration_s: float = 0.0
    redone: str = ""


def key_of(hashes: Sequence[str], procedure: Procedure) -> str:
    """What an item's result depends on, as a hash: the files, the procedure, and this program's version."""
    whole = {"files": list(hashes), "version": software()["version"], **procedure.fingerprint()}
    return hashlib.sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()[:KEY_LETTERS]


def work(item: Item, job: Job) -> Row:
    """Estimate one item and keep its result, or find that this was done; whatever goes wrong is in the row."""
    start = time.perf_counter()
    try:
        row = _row(item, job)
    except Exception as error:  # one photograph must not stop the others, whatever it meets
        row = _failure(item, error)
    return replace(row, files=item.files, duration_s=round(time.perf_counter() - start, 3))


def _row(item: Item, job: Job) -> Row:
    if item.trouble:
        return Row(item.files, UNREADABLE, item.trouble, item.remedy)
    contents = [read_photograph(path) for path in item.paths]
    hashes = [hashlib.sha256(data).hexdigest() for data in contents]
    key = key_of(hashes, job.procedure)
    kept, redone = kept_row(job.out, job.done[key]) if key in job.done else (None, "")
    if kept is not None:
        return replace(kept, reused=True)
    folder = f"{RESULTS}/{safe_stem(item.paths[0])}-{key}"
    with ResultFolder(job.out / folder) as place:
        return replace(_estimate(item, job, contents, hashes, folder, place), redone=redone)


def _estimate(
    item: Item, job: Job, contents: Sequence[bytes], hashes: Sequence[str], folder: str, place: ResultFolder
) -> Row:
    start = time.perf_counter()
    try:
        frames = [_read(*file, job.procedure) for file in zip(item.paths, contents, strict=True)]
        calibrated = _calibrated(job.procedure, frames)
    except ProcedureError as error:
        row = replace(_failure(item, error), sha256=hashes, folder=folder)
        calibrated = []
    else:
        judged = {record.name: judge(record, job.procedure.limits) for record in calibrated}
        row = _row_of(item, calibrated, judged, hashes, folder)
        if job.reports:
            _write_page(place, job.procedure, frames, calibrated, judged)
    about = {
        "procedure": job.procedure.name,
        "input": [{"path": name, "sha256": one} for name, one in zip(item.files, hashes, strict=True)],
        "parameters": job.procedure.told(),
        "batch": asdict(row),
        "duration_s": round(time.perf_counter() - start, 3),
    }
    write_psf_result(place, calibrated, about)
    return row


def _read(path: Path, data: bytes, procedure: Procedure) -> RawFrame:
    planes, layout = procedure.planes, procedure.layout
    names = None if ALL in planes else list(planes) or [default_plane(path, layout)]
    frame = read_frame(path, names, layout, data=data)
    if not procedure.trust_typed:
        check_typed(frame.exposure, procedure.optics, printable(path), "write trust_typed = true")
    return frame


def _calibrated(procedure: Procedure, frames: Sequence[RawFrame]) -> list[PlaneResult]:
    """Every plane of a photograph or of a pair, one after the other."""
    optics = cast(dict[str, Any], {"pixel_pitch_um": None, **procedure.optics})
    limit = partial(diffraction_limit, frames[0].exposure, **optics)
    if procedure.chart is not None:
        parameters = cast(PatternParameters, procedure.parameters)
        return list(calibrate(frames[0], procedure.chart.chart, parameters, limit, threads=1))
    pair = cast(TwoPhotoParameters, procedure.parameters)
    return list(calibrate_pair(frames[0], frames[1], pair, limit, threads=1))


def _row_of(
    item: Item,
    records: Iterable[PlaneResult],
    judged: Mapping[str, Sequence[Judgement]],
    hashes: Sequence[str],
    folder: str,
) -> Row:
    planes = {record.name: plane_row(record, judged[record.name]) for record in records}
    name, worst = max(planes.items(), key=lambda one: VERDICTS.index(one[1].verdict))
    reason = f"{name}: {worst.reason}" if worst.reason else ""
    return Row(item.files, worst.verdict, reason, worst.remedy, hashes, folder, planes)


def plane_row(record: PlaneResult, judged: Sequence[Judgement]) -> PlaneRow:
    """A plane's verdict by its estimate and its limits, the worse of both, with all that speaks against it."""
    numbers: dict[str, Mapping[str, Any]] = {
        name: {"value": value} for name, value in record.values.items() if isinstance(value, int | float)
    }
    for name, one in record.numbers.items():
        numbers[name] = {"value": one.value, "uncertainty": one.uncertainty, "unit": one.unit}
    return PlaneRow(
        verdict_within(record, judged),
        all_against(record, judged),
        record.remedy,
        numbers,
        [asdict(one) for one in judged],
    )


def _failure(item: Item, error: Exception) -> Row:
    """What an error says about an item: it is no photograph, or cannot be used, or this program fails on it."""
    if isinstance(error, ProcedureError):
        verdict = UNREADABLE if isinstance(error, BadInput | BadParameter) else REFUSED
        return Row(item.files, verdict, encodable(error.reason), encodable(error.remedy))
    if isinstance(error, MemoryError) or getattr(error, "code", None) == NO_MEMORY:
        return Row(item.files, LOST, "it takes more memory than an item may take here", MORE_MEMORY)
    reason = f"the program failed on something it did not foresee: {type(error).__name__}: {printable(error)}"
    return Row(item.files, FAULT, reason, "report it, with the photograph")


def _write_page(
    place: ResultFolder,
    procedure: Procedure,
    frames: Sequence[RawFrame],
    calibrated: Sequence[PlaneResult],
    judged: Mapping[str, Sequence[Judgement]],
) -> None:
    from station.reports.pattern_report import (  # here: it draws, and that import is slow
        PAGE,
        calibration_page,
        report_of_files,
    )

    report = report_of_files(procedure.name, frames, calibrated, procedure.told(), judged)
    place.write(PAGE, calibration_page(report).encode())


# --- what earlier runs have done ---------------------------------------------------------------------------------


def finished(out: Path) -> dict[str, str]:
    """Folders of the results in a batch's folder, by their keys."""
    folders = (out / RESULTS).glob(f"*-{'[0-9a-f]' * KEY_LETTERS}")
    return {folder.name[-KEY_LETTERS:]: f"{RESULTS}/{folder.name}" for folder in folders}


def kept_row(out: Path, folder: str) -> tuple[Row | None, str]:
    """The row that a result was kept with; None where it is not what was written, and what is not."""
    if wrong := damage(out / folder):
        return None, f"{', '.join(wrong)} of the result that was there: missing, or not what was written"
    try:
        row = json.loads((out / folder / RECORD).read_text(encoding="utf-8"))["batch"]
        planes = {name: PlaneRow(**plane) for name, plane in row.pop("planes").items()}
        return Row(**row, planes=planes), ""
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None, f"{RECORD} of the result that was there is not this version's"
