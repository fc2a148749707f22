"""One item of a batch, from its files to its folder: the work that is distributed to processes and clusters."""

import hashlib
import json
import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from procedures.numbers import Group, in_group
from procedures.outcome import BadInput, ProcedureError, Quantity, Verdict
from procedures.raw import read_photograph
from procedures.reading.exposure import Exposure
from station.batch.procedure_file import BatchProcedure
from station.calibration.folder_photographs import Item, naming_path
from station.common.durable_files import Unwritable
from station.common.progress import limited
from station.common.sanitise import encodable, printable, safe_stem
from station.common.versions import software
from station.procedure.base import Inputs, Procedure, to_record
from station.results.comparison import Comparison, Compliance
from station.results.measurement import BY_PLANE, Measurement, write_measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import InputFile, RecordHead, verdict_entry
from station.results.result_files import RECORD, ResultFolder, damage

RESULTS = "results"
KEY_LETTERS = 16
"""Letters of an item's hash at the end of its folder's name."""
PASS, DOUBTFUL, REFUSED = (str(one) for one in Verdict)
UNREADABLE, LOST, FAULT = "unreadable", "lost", "fault"
VERDICTS = (PASS, DOUBTFUL, REFUSED, UNREADABLE, LOST, FAULT)
"""Verdicts, the best first: trusted; doubtful; no result; unreadable file; process that died; error of this program."""
JUDGED = ("", *(str(one) for one in Compliance))
"""Verdicts against the specification, the best first; "" without a specification."""
USABLE = (PASS, DOUBTFUL)
NO_MEMORY = -4
"""Code of an OpenCV error (cv::Error::StsNoMem)."""
MORE_MEMORY = "look at this photograph by itself; if it is meant so, give more --memory-mb, and fewer --jobs"


@dataclass(frozen=True, eq=False)
class Job:
    """Data common to all items.

    out : folder of the batch
    done : results of earlier runs
    reports : whether a page is written for each item
    """

    procedure: BatchProcedure
    out: Path
    done: Mapping[str, str] = field(default_factory=dict)
    reports: bool = False


@dataclass(frozen=True)
class PlaneRow:
    """One plane: both verdicts, the numbers with value, uncertainty and unit, and the limits."""

    verdict: str
    reason: str
    remedy: str
    numbers: Mapping[str, Mapping[str, Any]]
    specification: str = ""
    limits: Sequence[Mapping[str, Any]] = ()

    @property
    def summary(self) -> dict[str, Quantity]:
        """The numbers in the summary of a batch; a number without an uncertainty has one of 0."""
        entries = {name: self.numbers[name] for name in in_group(Group.SUMMARY, self.numbers.keys())}
        return {
            str(name): Quantity(entry["value"], str(entry.get("unit", "1")), entry.get("uncertainty") or 0.0, "", 0)
            for name, entry in entries.items()
            if entry["value"] is not None
        }


@dataclass(frozen=True)
class ItemRow:
    """The result of an item.

    verdict : one of VERDICTS; of the measurement: the worst of the planes'
    specification : one of JUDGED; the worst verdict of the planes against their limits
    against : the limits that are missed or undecided, and the frequencies without an MTF, in sentences
    noted : recorded by the camera: exposure_s, f_number, focus_distance_mm, iso, focal_length_mm, camera, lens
    folder : of its result, relative to the batch; "" where none was written, so that a later run tries again
    reused : whether it is the result of an earlier run
    redone : why the result of an earlier run was not used; "" where there is none
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
    specification: str = ""
    against: str = ""
    noted: Mapping[str, float | str] = field(default_factory=dict)

    @property
    def camera(self) -> str:
        """The camera, as recorded by it; may be empty."""
        return str(self.noted.get("camera", ""))

    @property
    def usable(self) -> bool:
        """Whether there is a measurement that does not miss its specification."""
        return self.verdict in USABLE and self.specification != Compliance.MISSES

    @property
    def sure(self) -> bool:
        """Whether it is trusted, and meets its specification if there is one."""
        return self.verdict == PASS and self.specification in ("", Compliance.MEETS)


def work(item: Item, job: Job) -> ItemRow:
    """Measure one item and write its result, or find that of an earlier run; every error is in the row."""
    start = time.perf_counter()
    try:
        row = _row(item, job)
    except Exception as error:  # one photograph must not stop the others
        row = _failure(item, error)
    return replace(row, files=item.files, duration_s=round(time.perf_counter() - start, 3))


def _row(item: Item, job: Job) -> ItemRow:
    if item.trouble:
        return ItemRow(item.files, UNREADABLE, item.trouble, item.remedy)
    one_fails = job.procedure.procedure.inputs not in (Inputs.PHOTOGRAPHS, Inputs.FOLDER)
    hashes = [hash_of(path, required=one_fails) for path in item.paths]
    files = dict(zip(item.paths, hashes, strict=True)) | {
        file: hash_of(file) for file in job.procedure.procedure.files(item.paths, job.procedure.settings)
    }
    whole = {"files": hashes, "version": software()["version"], **job.procedure.fingerprint()}
    if further := list(files.values())[len(hashes) :]:
        whole["further"] = further
    key = hashlib.sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()[:KEY_LETTERS]
    kept, redone = kept_row(job.out, job.done[key]) if key in job.done else (None, "")
    if kept is not None:
        reason = kept.reason
        for before, now in zip(kept.files, item.files, strict=True):
            reason = reason.replace(before, now)
        return replace(kept, reason=reason, reused=True)
    folder = f"{RESULTS}/{safe_stem(naming_path(item.paths[0]))}-{key}"
    with ResultFolder(job.out / folder, force=True) as place:
        return replace(_measure(item, job, files, ItemRow(item.files, PASS, sha256=hashes, folder=folder), place),
                       redone=redone)  # fmt: skip


def hash_of(path: Path, *, required: bool = False) -> str:
    """SHA-256 of a file; "" if it cannot be read. Raises BadInput if it is required."""
    try:
        return hashlib.sha256(read_photograph(path)).hexdigest()
    except BadInput:
        if required:
            raise
        return ""


def changed_meanwhile(path: Path) -> BadInput:
    """The error about a file whose hash is no longer that of the item."""
    reason = f"{printable(path)} was changed while the batch read it"
    return BadInput(reason, "wait until it is copied, and run the batch again")


def _measure(item: Item, job: Job, files: Mapping[Path, str], row: ItemRow, place: ResultFolder) -> ItemRow:
    """Measure an item and write its result; `row` states its files."""
    start, batch = time.perf_counter(), job.procedure
    procedure = batch.procedure
    paths = [Path(os.path.commonpath(item.paths))] if procedure.inputs is Inputs.FOLDER else item.paths
    try:
        with limited(1):  # other processes work beside this one
            measurement = procedure.measure(paths, batch.settings, batch.terms)
    except ProcedureError as error:
        _check_unchanged(files)
        failure = _failure(item, error)
        row = replace(row, verdict=failure.verdict, reason=failure.reason, remedy=failure.remedy)
        measurement = _refusal(procedure, error)
        parameters = batch.parameters()
    else:
        _check_unchanged({path: files[path] for path in list(files)[len(item.paths) :]})
        for one in measurement.head.input:
            if files.get(Path(one.path), one.sha256) != one.sha256:
                raise changed_meanwhile(Path(one.path))
        row = replace(_judged(row, measurement.planes), noted=noted(measurement.exposure))
        parameters = {**measurement.head.parameters, **batch.terms.parameters()}
        if job.reports and procedure.draws(measurement):
            place.write(procedure.page_name, procedure.page(measurement))
    head = replace(
        measurement.head, input=tuple(map(InputFile, item.files, row.sha256)), parameters=parameters,
        arguments=[str(path) for path in item.paths], settings=measurement.head.settings or to_record(batch.settings),
        specification=batch.terms.specified(measurement.planes),
        batch=asdict(row),
        duration_s=round(time.perf_counter() - start, 3),
    )  # fmt: skip
    write_measurement(place, replace(measurement, head=head))
    return row


def _check_unchanged(files: Mapping[Path, str]) -> None:
    for path, known in files.items():
        if hash_of(path) != known:
            raise changed_meanwhile(path)


def _refusal(procedure: Procedure[Any], error: ProcedureError) -> Measurement:
    head, key = RecordHead(procedure.record_name), procedure.results_key
    if key == BY_PLANE:
        return Measurement(procedure.schema, head, ())
    refused = PlaneResult(procedure.name, Verdict.REFUSED, error.reason, error.remedy, pitch=0)
    return Measurement(procedure.schema, head, (refused,), entries=verdict_entry(refused), results_key=key)


def _judged(row: ItemRow, records: Sequence[PlaneResult]) -> ItemRow:
    planes = {record.name: plane_row(record) for record in records}
    name, worst = max(planes.items(), key=lambda one: VERDICTS.index(one[1].verdict))
    reason = f"{name}: {worst.reason}" if worst.reason else ""
    judged = max((plane.specification for plane in planes.values()), key=JUDGED.index)
    against = "; ".join(
        f"{one.name}: {words}"
        for one in records
        for words in (*(one.specification or Comparison()).against, *one.unavailable)
    )
    return replace(
        row, verdict=worst.verdict, reason=reason, remedy=worst.remedy, planes=planes, specification=judged,
        against=against,
    )  # fmt: skip


def noted(exposure: Exposure) -> dict[str, float | str]:
    """The settings that the camera recorded, without those that it did not."""
    names = ("camera", "lens", "exposure_s", "f_number", "iso", "focal_length_mm")
    entries = {name: getattr(exposure, name) for name in names}
    entries |= {"focus_distance_mm": exposure.subject_distance_mm, "captured_at": exposure.captured_at}
    return {name: encodable(value) if isinstance(value, str) else value for name, value in entries.items() if value}


def plane_row(record: PlaneResult) -> PlaneRow:
    """The row of a plane."""
    compared = (record.specification or Comparison()).to_record()
    numbers: dict[str, Mapping[str, Any]] = {
        name: {"value": value} for name, value in record.values.items() if isinstance(value, int | float)
    }
    physics = record.physics.value.numbers if record.physics is not None and record.physics.value is not None else {}
    for name, one in {**record.numbers, **physics}.items():
        numbers[name] = {"value": one.value, "uncertainty": one.uncertainty, "unit": one.unit}
    return PlaneRow(
        str(record.verdict), record.reason, record.remedy, numbers, compared["verdict"] or "", compared["limits"]
    )


def _failure(item: Item, error: Exception) -> ItemRow:
    """The row of an error: an unreadable file, a refused measurement, or a fault of this program."""
    if isinstance(error, ProcedureError):
        verdict = UNREADABLE if isinstance(error, BadInput) else LOST if isinstance(error, Unwritable) else REFUSED
        return ItemRow(item.files, verdict, encodable(error.reason), encodable(error.remedy))
    if isinstance(error, MemoryError) or getattr(error, "code", None) == NO_MEMORY:
        return ItemRow(item.files, LOST, "it takes more memory than an item may take here", MORE_MEMORY)
    reason = f"the program failed unexpectedly: {type(error).__name__}: {printable(error)}"
    return ItemRow(item.files, FAULT, reason, "report it, with the photograph")


def finished(out: Path) -> dict[str, str]:
    """Folders of the results in a batch's folder, by their keys."""
    folders = (out / RESULTS).glob(f"*-{'[0-9a-f]' * KEY_LETTERS}")
    return {folder.name[-KEY_LETTERS:]: f"{RESULTS}/{folder.name}" for folder in folders}


def row_of_record(record: Mapping[str, Any]) -> ItemRow:
    """A row as it was written. Raises KeyError, TypeError, AttributeError where it is none."""
    planes = {name: PlaneRow(**plane) for name, plane in record["planes"].items()}
    return ItemRow(**{**record, "planes": planes})


def kept_row(out: Path, folder: str) -> tuple[ItemRow | None, str]:
    """The row of an earlier result; None if its files were changed, and the reason."""
    if wrong := damage(out / folder):
        return None, f"{', '.join(wrong)} of the result that was there: missing, or not what was written"
    try:
        return row_of_record(json.loads((out / folder / RECORD).read_text(encoding="utf-8"))["batch"]), ""
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None, f"{RECORD} of the result that was there is not this version's"
