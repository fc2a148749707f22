"""Many photographs without a terminal: distributed, written as they are finished, summarised in one table.

A batch's folder holds `results/NAME-HASH/` for each photograph (the files of `station psf`), `results.jsonl` with one
line for each (written as they are finished, sorted at the end), `summary.csv` with one line for each plane, and
`result.json`. Results of earlier runs with the same procedure and program are used again.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any
from urllib.parse import quote

from procedures.numbers import Group, Number, in_group
from station.batch.allowance import Allowance
from station.batch.batch_folder import LINES, PAGE, TABLE, check_own, known_hashes, owned, unwritable
from station.batch.item import JUDGED, LOST, VERDICTS, ItemRow, Job, PlaneRow, work
from station.batch.procedure_file import BatchProcedure
from station.batch.process_pool import Lost, Stop, run_in_processes
from station.calibration.folder_photographs import Item
from station.common.atomic_files import write_whole
from station.common.sanitise import cell, printable
from station.common.versions import software
from station.results.exports import csv_bytes
from station.results.result_files import PUBLISHING, RECORD, plain, sealed_text

SCHEMA = "station/batch/1"


def followed(rows: Sequence[ItemRow]) -> list[Number]:
    """The numbers in the summary over all photographs."""
    return in_group(Group.SUMMARY, {name for row in rows for plane in row.planes.values() for name in plane.numbers})


HEAD = (
    "files",
    "verdict",
    "plane",
    "plane_verdict",
    "reason",
    "remedy",
    "specification",
    "against",
    "folder",
    "sha256",
)
"""First columns of the summary."""
FAILURE = ("files", "verdict", "specification", "reason", "against")
"""Entries of a failed item in the record."""
NOTED = (
    ("camera", "camera"), ("lens", "lens"), ("captured_at", "captured_at"), ("exposure [s]", "exposure_s"),
    ("f_number", "f_number"), ("iso", "iso"), ("focal_length [mm]", "focal_length_mm"),
    ("focus_distance [mm]", "focus_distance_mm"),
)  # fmt: skip
"""Headings of the settings recorded by the camera, and their names in a row."""
Work = Callable[[Item, Job], ItemRow]
Tls = tuple[Path, Path, Path] | None


@dataclass(frozen=True, eq=False)
class Batch:
    """The results of the items in order; `undone` were not begun before the batch was stopped."""

    job: Job
    rows: tuple[ItemRow, ...]
    undone: int
    duration_s: float

    @property
    def counts(self) -> dict[str, int]:
        """Number of items by verdict, the best first."""
        counted = Counter(row.verdict for row in self.rows)
        return {verdict: counted[verdict] for verdict in VERDICTS if counted[verdict]}

    @property
    def judged(self) -> dict[str, int]:
        """Number of items by verdict against the specification; empty without one."""
        counted = Counter(row.specification for row in self.rows)
        return {verdict: counted[verdict] for verdict in JUDGED[1:] if counted[verdict]}

    @property
    def failed(self) -> tuple[ItemRow, ...]:
        """The items that are not usable."""
        return tuple(row for row in self.rows if not row.usable)


def run_batch(
    items: Sequence[Item],
    job: Job,
    *,
    jobs: int = 1,
    cluster: str | None = None,
    allowance: Allowance | None = None,
    tls: Tls = None,
    stop: Stop | None = None,
    report: Callable[[ItemRow], None] = lambda row: None,
    function: Work = work,
    force: bool = False,
) -> tuple[Batch, str]:
    """Work on all items, write each result at once, then the summaries; returns the record's text too.

    Parameters
    ----------
    jobs : int
        Processes at a time.
    cluster : str, optional
        The address of a Dask cluster, or "local" for one of `jobs` processes here.
    allowance : Allowance, optional
        Limits of each item; by default its share of this machine's memory, and an hour.
    tls : (Path, Path, Path), optional
        Authority, certificate and key for a cluster at tls://...
    stop : Stop, optional
        Request to stop from a signal or another thread.
    report : callable
        Called with every row when it is finished.
    function : callable
        The work itself.
    force : bool
        Whether files in the folder that no batch has written are overwritten.

    Raises
    ------
    BadParameter
        If the folder cannot be written, holds somebody else's files, or there is no such cluster.
    """
    start, stop = time.perf_counter(), stop or Stop()
    rows: dict[int, ItemRow] = {}
    if not force:
        check_own(job.out)
    with owned(job.out), _lines(job.out) as write:
        with closing(_answers(items, job, jobs, cluster, allowance, tls, stop, function)) as answers:
            for number, answer in answers:
                row = _lost(items[number], answer) if isinstance(answer, Lost) else answer
                rows[number] = row
                write(row)
                report(row)
        batch = Batch(
            job, tuple(rows[i] for i in sorted(rows)), len(items) - len(rows), round(time.perf_counter() - start, 3)
        )
        return batch, _write(batch)


def _answers(
    items: Sequence[Item],
    job: Job,
    jobs: int,
    cluster: str | None,
    allowance: Allowance | None,
    tls: Tls,
    stop: Stop,
    function: Work,
) -> Generator[tuple[int, ItemRow | Lost], None, None]:
    jobs = min(jobs, len(items))
    allowance = allowance or Allowance.fair(jobs)
    if cluster is None:
        return run_in_processes(function, job, items, jobs, stop, allowance)
    from station.batch.dask_pool import run_on_cluster

    return run_on_cluster(function, job, items, jobs, stop, cluster, allowance, tls)


def _lost(item: Item, lost: Lost) -> ItemRow:
    remedy = "look at this photograph by itself; if the system ran out of memory, use fewer --jobs"
    return ItemRow(item.files, LOST, lost.reason, remedy)


# --- the batch's folder ------------------------------------------------------------------------------------------


@contextmanager
def _lines(out: Path) -> Iterator[Callable[[ItemRow], None]]:
    """Write a line for each row, at once."""
    try:
        with (out / LINES).open("w", encoding="utf-8") as file:

            def write(row: ItemRow) -> None:
                file.write(_line(row))
                file.flush()

            yield write
    except OSError as error:
        raise unwritable(out, error) from error


def _line(row: ItemRow) -> str:
    return json.dumps(plain(asdict(row)), ensure_ascii=False, allow_nan=False) + "\n"


def _write(batch: Batch) -> str:
    """Write the files of the batch; returns the record's text."""
    out = batch.job.out
    files = {LINES: "".join(map(_line, batch.rows)).encode(), TABLE: _table(batch.rows), PAGE: _page(batch)}
    hashes = {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}
    before = known_hashes(out)  # after a crash the note states which files are a batch's
    note = {name: [*before.get(name, ()), one] for name, one in hashes.items()}
    write_whole(out / PUBLISHING, json.dumps({"files": note}).encode())
    for name, data in files.items():
        write_whole(out / name, data)
    text = sealed_text(_record(batch), hashes)
    write_whole(out / RECORD, text.encode())
    (out / PUBLISHING).unlink(missing_ok=True)
    return text


def _page(batch: Batch) -> bytes:
    """The batch's page."""
    from station.reports.batches.batch_page import BatchLine, BatchReport, ItemNumber, batch_page  # here: it draws

    lines = [
        BatchLine(
            " + ".join(map(printable, row.files)), row.verdict, row.specification,
            "; ".join(words for words in (row.reason, row.against) if words), quote(row.folder),
            page=bool(row.folder) and (batch.job.out / row.folder / PAGE).is_file(),
        )
        for row in batch.rows
    ]  # fmt: skip
    numbers = followed(batch.rows)
    samples = [
        ItemNumber(str(row.noted.get("camera", "")), name, number, value["value"], value.get("unit", "1"))
        for row in batch.rows
        for name, plane in row.planes.items()
        for number in numbers
        if (value := plane.numbers.get(number)) is not None
    ]
    procedure = batch.job.procedure
    title = f"{len(batch.rows)} items by the procedure {procedure.name}"
    report = BatchReport(title, batch.counts, batch.judged, lines, samples, _bounds(procedure), batch.undone)
    return batch_page(report).encode()


def _bounds(procedure: BatchProcedure) -> dict[str, list[float]]:
    """The finite bounds of limits in the unit of the batch, by number."""
    bounds: dict[str, list[float]] = {}
    for limit in procedure.terms.specification.limits:
        if limit.at is None and limit.unit is procedure.terms.unit:
            for name in [f"{limit.number}_{one}" for one in limit.directions] + [limit.number]:
                bounds.setdefault(name, []).extend(one for one in (limit.least, limit.most) if math.isfinite(one))
    return bounds


def _record(batch: Batch) -> dict[str, Any]:
    procedure = batch.job.procedure
    return {
        "schema": SCHEMA,
        **procedure.fingerprint(),
        "photographs": len(batch.rows),
        "undone": batch.undone,
        "reused": sum(row.reused for row in batch.rows),
        "verdicts": batch.counts,
        "specification_verdicts": batch.judged,
        "planes": statistics(batch.rows),
        "failed": [{name: getattr(row, name) for name in FAILURE} for row in batch.failed],
        "software": software(),
        "duration_s": batch.duration_s,
    }


def statistics(rows: Sequence[ItemRow]) -> dict[str, dict[str, Any]]:
    """Verdict counts of every plane, and median, minimum and maximum of the numbers in the summary."""
    numbers = followed(rows)
    summary: dict[str, dict[str, Any]] = {}
    for name in sorted({name for row in rows for name in row.planes}):
        planes = [row.planes[name] for row in rows if name in row.planes]
        counted = Counter(plane.verdict for plane in planes)
        entry: dict[str, Any] = {"verdicts": {verdict: counted[verdict] for verdict in VERDICTS if counted[verdict]}}
        for number in numbers:
            values = [plane.numbers[number]["value"] for plane in planes if number in plane.numbers]
            if values:
                entry[number] = {"n": len(values), "median": median(values), "min": min(values), "max": max(values)}
        summary[name] = entry
    return summary


def _table(rows: Sequence[ItemRow]) -> bytes:
    """One line for each plane, or for an item without planes; headings state units; no cell is a formula."""
    planes = [(row, name, plane) for row in rows for name, plane in _planes(row)]
    units = {name: one.get("unit", "") for _, _, plane in planes if plane for name, one in plane.numbers.items()}
    numbers = sorted(units)
    columns = [column for number in numbers for column in (number, f"{number}_uncertainty")]
    head = [*HEAD, *(heading for heading, _ in NOTED), *(_with_unit(one, units) for one in columns)]
    table = [head]
    for row, name, plane in planes:
        about = row if plane is None else plane
        judged, against = (plane.specification, _against(plane)) if plane else (row.specification, row.against)
        words = (" + ".join(row.files), row.verdict, name, plane.verdict if plane else "", about.reason, about.remedy)
        cells = [cell(word) for word in (*words, judged, against, row.folder, " ".join(row.sha256))]
        cells += [cell(str(row.noted.get(key, ""))) for _, key in NOTED]
        table.append(cells + [_number(plane.numbers if plane else {}, *column) for column in _columns(numbers)])
    return csv_bytes(table)


def _with_unit(column: str, units: Mapping[str, str]) -> str:
    """A heading with the unit of its number, if it has one."""
    unit = units.get(column) or units.get(column.removesuffix("_uncertainty")) or ""
    return column if unit in ("", "1") else f"{column} [{unit}]"


def _against(plane: PlaneRow) -> str:
    return "; ".join(str(one["words"]) for one in plane.limits if one["verdict"] != "meets")


def _planes(row: ItemRow) -> list[tuple[str, PlaneRow | None]]:
    return [*row.planes.items()] or [("", None)]


def _columns(numbers: Sequence[str]) -> list[tuple[str, str]]:
    return [(number, kind) for number in numbers for kind in ("value", "uncertainty")]


def _number(numbers: Mapping[str, Mapping[str, Any]], name: str, kind: str) -> str:
    value = numbers.get(name, {}).get(kind)
    return "" if value is None else f"{value:.9g}"
