"""`station batch`: many photographs without a terminal."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.cli.psf.terms import jobs_option
from station.cli.terminal.command import PATH, FiniteNumber, command, force_option
from station.common.errors import INTERRUPTED, log, log_json_option
from station.drawing.colours import TERMINAL_COLOURS

if TYPE_CHECKING:
    from rich.table import Table

    from station.batch.item import ItemRow
    from station.batch.procedure_file import BatchProcedure
    from station.batch.run import Batch
    from station.calibration.folder_photographs import Item

SOME_FAILED = 1
ITEMS = {
    "pair": "pairs", "scene": "pairs", "results": "pairs", "photograph": "photographs", "series": "photographs",
    "several": "files",
}  # fmt: skip
MOST_NAMED = 40
"""Number of unusable photographs on the screen; the files list all."""


@command("batch", strict=True, as_json=True)
@click.argument("folders", metavar="FOLDER...", nargs=-1, required=True, type=PATH)
@click.option("--procedure", "file", type=PATH, required=True, help="What to do, in TOML.")
@click.option("--out", type=PATH, required=True, help="Folder for the results.")
@jobs_option
@click.option("--cluster", metavar="ADDRESS", help="Distribute the work by Dask (extra `cluster`).")
@click.option(
    "--cluster-tls", "tls", metavar="CA CERT KEY", nargs=3, type=PATH,
    help="Files for a cluster at tls://... : authority, own certificate, own key.",
)  # fmt: skip
@click.option(
    "--memory-mb",
    type=click.IntRange(256, 1 << 24),
    help="What a photograph may take.  [default: its share of the machine]",
)
@click.option(
    "--time-s", type=FiniteNumber(min=1), default=3600, show_default=True, help="How long a photograph may take."
)
@click.option("--reports", is_flag=True, help="Write a page for every photograph too.")
@click.option("--parquet", is_flag=True, help="Write summary.parquet beside summary.csv (extra `parquet`).")
@force_option
def batch(
    folders: tuple[Path, ...], file: Path, out: Path, jobs: int | None, cluster: str | None,
    tls: tuple[Path, Path, Path] | None, memory_mb: int | None, time_s: float, reports: bool, parquet: bool,
    strict: bool, as_json: bool,
) -> None:  # fmt: skip
    """Measure all photographs in FOLDER... by any procedure, and compare the numbers with limits.

    Results of an earlier run with the same procedure are used again. The first Ctrl-C finishes the items in work, the
    second stops at once; finished results are kept.
    """
    if tls is not None and not (cluster or "").startswith("tls://"):
        raise click.UsageError("--cluster-tls goes with --cluster tls://HOST:PORT")
    from station.batch.procedure_file import read_procedure

    if cluster is not None:  # its workers may run in other folders
        folders, out = tuple(folder.absolute() for folder in folders), out.absolute()
    procedure = read_procedure(file)
    limits = {} if memory_mb is None else {"memory_bytes": memory_mb * 1_000_000}
    carry_out(
        procedure, folders, out, jobs=jobs, reports=reports, strict=strict, as_json=as_json, cluster=cluster, tls=tls,
        time_s=time_s, parquet=parquet, **limits,
    )  # fmt: skip


def carry_out(
    procedure: BatchProcedure, folders: tuple[Path, ...], out: Path, *, jobs: int | None, reports: bool,
    strict: bool = False, as_json: bool = False, cluster: str | None = None,
    tls: tuple[Path, Path, Path] | None = None, time_s: float = 3600, memory_bytes: int | None = None,
    parquet: bool = False,
) -> None:  # fmt: skip
    """Run a batch, report its progress, and exit with its code."""
    from station.batch.item import Job, finished
    from station.batch.process_pool import Allowance, Stop
    from station.batch.run import run_batch
    from station.common.stop_signals import guarded

    items = _items(folders, out, procedure)
    words = ITEMS.get(procedure.procedure.inputs, "folders")
    log("found", f"found {len(items)} {words}", items=len(items))
    jobs = jobs or os.cpu_count() or 1
    fair = Allowance.fair(min(jobs, len(items)))
    allowance = Allowance(memory_bytes or fair.memory_bytes, time_s)
    job, stop = Job(procedure, out, finished(out), reports), Stop()
    with (
        guarded(lambda: None, lambda: _ask(stop), terminated=INTERRUPTED),
        _reporter(len(items)) as report,
        _stopped(out),
    ):
        done, text = run_batch(
            items, job, jobs=jobs, cluster=cluster, allowance=allowance, tls=tls, stop=stop, report=report,
            force=force_option.given(), parquet=parquet,
        )  # fmt: skip
    if as_json:
        click.echo(text, nl=False)
    else:
        _show(done)
    log("written", f"wrote {out / 'summary.csv'}", path=str(out / "summary.csv"))
    _summarise(done)
    if stop.asked:
        log("interrupted", f"interrupted; {done.undone} were not begun", level="error", undone=done.undone)
        raise click.exceptions.Exit(INTERRUPTED)
    if done.tally.failed or (strict and not done.tally.all_sure):
        raise click.exceptions.Exit(SOME_FAILED)


def _summarise(done: Batch) -> None:
    """Write the procedure's own summary of the batch, if it has one."""
    from station.common.durable_files import write_whole

    procedure = done.job.procedure.procedure
    summary = procedure.summary(done.rows)
    if summary is None:
        return
    for words in summary.warnings:
        log("several", words, level="warning", remedy="make a series of each by itself")
    for name, data in summary.files.items():
        write_whole(done.job.out / name, data)
        log("written", f"wrote {done.job.out / name}", path=str(done.job.out / name))
    for line in summary.lines:
        log(procedure.name, line)


def _items(folders: tuple[Path, ...], out: Path, batch: BatchProcedure) -> list[Item]:
    from station.batch.procedure_file import IN_PAIRS
    from station.calibration.folder_photographs import Item, by_folder, find_frames, in_pairs, in_rows, singly, unread
    from station.procedure.base import Inputs

    missed: list[Item] = []
    procedure = batch.procedure
    suffixes, inputs = procedure.suffixes, procedure.inputs
    frames = find_frames(folders, out, lambda folder, error: missed.append(unread(folder, error)), suffixes)
    if batch.pairs is not None:
        return in_rows(frames, batch.pairs, most=2 if inputs is Inputs.PAIR else None) + missed
    if inputs in IN_PAIRS:
        items = in_pairs(frames, batch.endings)
        pairs = [item for item in items if not item.trouble]
        used = {file for pair in pairs for file in batch.procedure.files(pair.paths, batch.settings)}
        return [item for item in items if not (item.trouble and used.issuperset(item.paths))] + missed
    if inputs is Inputs.FOLDER:
        return [Item(tuple(find_frames([folder], out, suffixes=suffixes))) for folder in folders] + missed
    return (by_folder(frames) if inputs is Inputs.PHOTOGRAPHS else singly(frames)) + missed


def _ask(stop: object) -> None:
    stop.ask()  # type: ignore[attr-defined]
    log("stopping", "finishing what runs; Ctrl-C again stops now", level="warning")


@contextmanager
def _stopped(out: Path) -> Iterator[None]:
    try:
        yield
    except (KeyboardInterrupt, SystemExit) as error:
        log("interrupted", f"stopped; what was done is kept in {out}, and is not done again", level="error")
        raise click.exceptions.Exit(INTERRUPTED) from error


@contextmanager
def _reporter(total: int) -> Iterator[Callable[[ItemRow], None]]:
    """Report every row with rate and remaining time: a bar on a terminal, lines otherwise."""
    import time

    from station.common.progress import StepRate, bar

    rate = StepRate(total, time.monotonic)

    def report(row: ItemRow) -> None:
        left = rate.step()
        level = "info" if row.sure else "warning"
        words = f"{rate.done} of {total}, {left}: {_sentence(row)}"
        milliseconds = round(1000 * row.duration_s)
        facts: dict[str, Any] = {"file": row.files[0], "verdict": row.verdict, "folder": row.folder}
        facts |= {"specification": row.specification} if row.specification else {}
        log("item", words, level=level, remedy=row.remedy, reused=row.reused, dur_ms=milliseconds, **facts)

    if sys.stderr.isatty() and not log_json_option.given():
        with bar(total) as progress:
            yield lambda row: progress(f"{rate.step()}  {_sentence(row)}")
    else:
        yield report


def _sentence(row: ItemRow) -> str:
    from station.common.sanitise import printable
    from station.results.comparison import measurement_words, specification_words

    words = f"{printable(' + '.join(row.files))}: {measurement_words(row.verdict)}"
    words += f"; {printable(row.reason)}" if row.reason else ""
    words += f"; {specification_words(row.specification)}" if row.specification else ""
    words += f"{': ' if row.specification else '; '}{printable(row.against)}" if row.against else ""
    words += f" (done again: {printable(row.redone)})" if row.redone else ""
    return f"{words} (done before)" if row.reused else words


def _show(done: Batch) -> None:
    """Print the planes' statistics, the failed photographs with their reasons, and the counts."""
    from rich.console import Console

    from station.results.comparison import measurement_words

    console = Console(highlight=False)
    console.print(_planes(done))
    failed = len(done.tally.failed)
    if failed:
        console.print(_wrong(done))
    if failed > MOST_NAMED:
        console.print(f"... and {failed - MOST_NAMED} more, in summary.csv", style="dim")
    counts = _counted(done.counts, measurement_words)
    console.print(f"{len(done.rows)} done in {done.duration_s:.1f} s; measurements: {counts or 'none'}.")
    if done.judged:
        console.print(f"Against the specification: {_counted(done.judged, str)}.")


def _counted(counts: Mapping[str, int], words: Callable[[str], str]) -> str:
    return ", ".join(f"{count} {words(verdict)}" for verdict, count in counts.items())


def _planes(done: Batch) -> Table:
    from rich import box
    from rich.table import Table

    from station.results.comparison import measurement_words

    numbers = done.tally.followed
    table = Table(
        "plane", *(one.short for one in numbers), "verdicts", box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False
    )
    for name, entry in done.tally.statistics().items():
        medians = [f"{entry[number]['median']:.4f}" if number in entry else "—" for number in numbers]
        verdicts = _counted(entry["verdicts"], measurement_words)
        table.add_row(name, *medians, verdicts)
    table.caption = "Medians over all photographs."
    return table


def _wrong(done: Batch) -> Table:
    from rich import box
    from rich.markup import escape
    from rich.table import Column, Table

    from station.common.sanitise import printable
    from station.results.comparison import measurement_words

    photograph = Column("photograph", overflow="fold")  # names differ at their ends
    heads = (photograph, "measurement", "specification", "why")
    table = Table(*heads, box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False)
    for row in islice(done.failed, MOST_NAMED):
        why = "; ".join(words for words in (row.reason, row.against) if words)
        words = printable(" + ".join(row.files)), printable(why)
        verdict = f"[{TERMINAL_COLOURS['fail']}]{measurement_words(row.verdict)}[/]"
        table.add_row(escape(words[0]), verdict, row.specification, escape(words[1]))
    return table
