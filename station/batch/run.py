"""Many photographs without a terminal: distributed, written as they are finished, summarised in one table.

A batch's folder holds `results/NAME-HASH/` for each photograph (the files of `station psf`), `results.jsonl` with one
line for each (written as they are finished, sorted at the end), `summary.csv` with one line for each plane, on request
the same as `summary.parquet`, and `result.json`. Results of earlier runs with the same procedure and program are used
again. Rows stay on the disk: memory does not grow with what is measured.
"""

import json
import math
import shutil
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any
from urllib.parse import quote

from procedures.outcome import BadParameter
from station.batch.item import JUDGED, LOST, RESULTS, VERDICTS, ItemRow, Job, work
from station.batch.process_pool import Allowance, Lost, Stop, run_in_processes
from station.batch.stored_rows import StoredRows, Tally, check_parquet, write_csv, write_parquet
from station.calibration.folder_photographs import Item
from station.common.durable_files import Unwritable, holds, read_own, write_whole, written
from station.common.sanitise import printable
from station.common.versions import software
from station.procedure.schema import DRAFT, limit_schema
from station.results.comparison import Compliance
from station.results.limits import Place
from station.results.result_files import PUBLISHING, RECORD, json_object, own_hashes, sealed_text
from station.results.units import Unit

SCHEMA = "station/batch/1"
FAILURE = ("files", "verdict", "specification", "reason", "against")
Work = Callable[[Item, Job], ItemRow]
Tls = tuple[Path, Path, Path] | None


@dataclass(frozen=True, eq=False)
class Batch:
    """The results of the items in order; `undone` were not begun before the batch was stopped."""

    job: Job
    rows: Sequence[ItemRow]
    undone: int
    duration_s: float

    @cached_property
    def tally(self) -> Tally:
        """Counts and values over all rows."""
        return Tally.of(self.rows)

    @property
    def counts(self) -> dict[str, int]:
        """Number of items by verdict, the best first."""
        return {verdict: count for verdict in VERDICTS if (count := self.tally.verdicts[verdict])}

    @property
    def judged(self) -> dict[str, int]:
        """Number of items by verdict against the specification; empty without one."""
        return {verdict: count for verdict in JUDGED[1:] if (count := self.tally.specifications[verdict])}

    @property
    def failed(self) -> Iterator[ItemRow]:
        return (self.rows[place] for place in self.tally.failed)


def run_batch(
    items: Sequence[Item], job: Job, *, jobs: int = 1, cluster: str | None = None, allowance: Allowance | None = None,
    tls: Tls = None, stop: Stop | None = None, report: Callable[[ItemRow], None] = lambda row: None,
    function: Work = work, force: bool = False, parquet: bool = False,
) -> tuple[Batch, str]:  # fmt: skip
    """Work on all items, write each result at once, then the summaries; returns the record's text too.

    Raises BadParameter if the folder cannot be written, holds somebody else's files, pyarrow is missing, or there is no
    such cluster.

    jobs : processes at a time
    cluster : the address of a Dask cluster
    allowance : limits of each item; by default its share of this machine's memory, and an hour; a cluster has its own
    tls : authority, certificate and key for a cluster at tls://...
    stop : request to stop from a signal or another thread
    report : called with every row when it is finished
    function : the work itself
    force : whether files in the folder that no batch has written are overwritten
    parquet : whether the summary is written as a Parquet file too; an existing one always is, so that both agree
    """
    start, stop = time.perf_counter(), stop or Stop()
    if parquet := parquet or (job.out / PARQUET).exists():
        check_parquet()
    if not force:
        check_own(job.out)
    with owned(job.out), _stored(job.out) as rows:
        with closing(_answers(items, job, jobs, cluster, allowance, tls, stop, function)) as answers:
            for number, answer in answers:
                if isinstance(answer, Lost):
                    remedy = "look at this photograph by itself; if the system ran out of memory, use fewer --jobs"
                    row = ItemRow(items[number].files, LOST, answer.reason, remedy)
                else:
                    row = answer
                rows.add(number, row)
                report(row)
        batch = Batch(job, rows, len(items) - len(rows), round(time.perf_counter() - start, 3))
        return batch, _write(batch, rows, parquet=parquet)


def _answers(
    items: Sequence[Item], job: Job, jobs: int, cluster: str | None, allowance: Allowance | None, tls: Tls,
    stop: Stop, function: Work,
) -> Generator[tuple[int, ItemRow | Lost], None, None]:  # fmt: skip
    if cluster is None:
        jobs = min(jobs, len(items))
        return run_in_processes(function, job, items, jobs, stop, allowance or Allowance.fair(jobs))
    from station.batch.dask_pool import run_on_cluster

    return run_on_cluster(function, job, items, stop, cluster, tls)


@contextmanager
def _stored(out: Path) -> Iterator[StoredRows]:
    try:
        rows = StoredRows(out / LINES)
        with closing(rows):
            yield rows
    except OSError as error:
        raise Unwritable(out, error) from error


def _write(batch: Batch, rows: StoredRows, *, parquet: bool) -> str:
    out, units = batch.job.out, batch.tally.units
    writers: dict[str, Callable[[Path], object]] = {
        LINES: rows.write_sorted,
        TABLE: lambda path: write_csv(path, rows, units),
        PAGE: lambda path: path.write_bytes(_page(batch)),
    }
    if parquet:
        writers[PARQUET] = lambda path: write_parquet(path, rows, units)
    with ExitStack() as stack:
        files = {name: stack.enter_context(written(out / name, write)) for name, write in writers.items()}
        hashes = {name: file.sha256 for name, file in files.items()}
        before = own_hashes(out)  # after a crash the note states which files are a batch's
        note = {name: [*before.get(name, ()), one] for name, one in hashes.items()}
        write_whole(out / PUBLISHING, json.dumps({"files": note}).encode())
        for file in files.values():
            file.publish()
        rows.replaced()
    text = sealed_text(_record(batch), hashes)
    write_whole(out / RECORD, text.encode())
    (out / PUBLISHING).unlink(missing_ok=True)
    return text


def _page(batch: Batch) -> bytes:
    from station.reports.batches.batch_page import (  # here: it draws
        MAX_LINES,
        BatchLine,
        BatchReport,
        NumberGroup,
        batch_page,
    )

    lines = [
        BatchLine(
            " + ".join(map(printable, row.files)), row.verdict, row.specification,
            "; ".join(words for words in (row.reason, row.against) if words), quote(row.folder),
            page=bool(row.folder) and (batch.job.out / row.folder / PAGE).is_file(), camera=row.camera,
            planes={name: plane.summary for name, plane in row.planes.items()},
        )
        for row in batch.rows[:MAX_LINES]
    ]  # fmt: skip
    groups = [NumberGroup(*group, one.unit, one.values, one.uncertainties) for group, one in batch.tally.series.items()]
    procedure, count = batch.job.procedure, len(batch.rows)
    title = f"{count} items by the procedure {procedure.name}"
    bounds: dict[str, list[float]] = {}
    for limit in procedure.terms.specification.limits:
        if limit.at is None and limit.unit is procedure.terms.unit:
            for name in [f"{limit.number}_{direction}" for direction in limit.directions] + [limit.number]:
                bounds.setdefault(name, []).extend(one for one in (limit.least, limit.most) if math.isfinite(one))
    report = BatchReport(title, batch.counts, batch.judged, lines, count, groups, bounds, batch.undone)
    return batch_page(report).encode()


def _record(batch: Batch) -> dict[str, Any]:
    procedure = batch.job.procedure
    return {
        "schema": SCHEMA,
        **procedure.fingerprint(),
        "photographs": len(batch.rows),
        "undone": batch.undone,
        "reused": batch.tally.reused,
        "verdicts": batch.counts,
        "specification_verdicts": batch.judged,
        "planes": batch.tally.statistics(),
        "failed": [{name: getattr(row, name) for name in FAILURE} for row in batch.failed],
        "software": software(),
        "duration_s": batch.duration_s,
    }


def batch_schema() -> dict[str, Any]:
    """The schema (draft 2020-12) of a batch's `result.json`."""
    count, whole = {"type": "integer", "minimum": 0}, {"type": "object"}
    limit = limit_schema({"place": {"enum": [*Place]}, "unit": {"enum": [*Unit]}})
    known = {
        "schema": {"const": SCHEMA},
        "procedure": {"type": "string"},
        **dict.fromkeys(("photographs", "undone", "reused"), count),
        "verdicts": {**whole, "propertyNames": {"enum": [*VERDICTS]}, "additionalProperties": count},
        "specification_verdicts": {**whole, "propertyNames": {"enum": [*Compliance]}, "additionalProperties": count},
        "specification": {
            **whole, "required": ["title", "sha256", "limits"],
            "properties": {"limits": {"type": "array", "items": limit}},
        },
        "planes": whole,
        "failed": {"type": "array", "items": {**whole, "required": [*FAILURE]}},
        "software": whole,
        "duration_s": {"type": "number"},
    }  # fmt: skip
    title = "result.json of station batch"
    return {"$schema": DRAFT, "title": title, **whole, "required": [*known], "properties": known}


LINES, TABLE, PARQUET, PAGE = "results.jsonl", "summary.csv", "summary.parquet", "report.html"
LINE_BEGINS = '{"files": '


def check_own(out: Path) -> None:
    """Raise BadParameter if a file that a batch would overwrite was not written by a batch."""
    known = own_hashes(out)
    own = {RECORD: bool(json_object(out / RECORD).get("schema")), LINES: _begins(out / LINES, LINE_BEGINS)}
    own |= {name: any(holds(out / name, one) for one in known.get(name, ())) for name in (TABLE, PARQUET, PAGE)}
    foreign = [name for name, known in own.items() if (out / name).exists() and not known]
    if foreign:
        raise BadParameter(
            f"{out} holds {', '.join(foreign)}, which no batch has written as it is now",
            "name a new folder with --out, move the file away, or add --force to write over it",
        )


def _begins(path: Path, letters: str) -> bool:
    """Whether a file is empty, or begins with these letters."""
    try:
        data = read_own(path)
    except OSError:
        return False
    return not data or data.startswith(letters.encode())


@contextmanager
def owned(out: Path) -> Iterator[None]:
    """Lock the folder for one batch; incomplete results of killed workers are removed before and after."""
    try:
        (out / RESULTS).mkdir(parents=True, exist_ok=True)
        lock = (out / ".lock").open("w")
    except OSError as error:
        raise Unwritable(out, error) from error
    with lock:
        _lock(lock, out)
        _sweep(out)
        yield
        _sweep(out)


def _lock(lock: Any, out: Path) -> None:
    """Lock until the file is closed, also by a kill. Not on Windows, which has no such lock."""
    try:
        import fcntl
    except ImportError:
        return
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        raise BadParameter(f"another batch is writing {out}", "wait for it, or name another folder") from error


def _sweep(out: Path) -> None:
    for unfinished in (out / RESULTS).glob("*/.unfinished-*"):
        shutil.rmtree(unfinished, ignore_errors=True)
        if not any(unfinished.parent.iterdir()):
            unfinished.parent.rmdir()
