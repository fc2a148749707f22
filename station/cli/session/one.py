"""`station session show`, `resume`, `recompute`, `report` and `delete`: one session."""

from __future__ import annotations

import hashlib
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.cli.psf.terms import certificate_options, details_of, overlay_option
from station.cli.result_log import check_strict
from station.cli.session.group import find_session, newest_unfinished, session_argument, session_names, sessions_option
from station.cli.terminal.bench_options import config_option, usual_config
from station.cli.terminal.command import PATH, columns, command, completed
from station.cli.terminal.inherited import inherited
from station.cli.terminal.progress import awaited, progress
from station.common.errors import log

if TYPE_CHECKING:
    from station.guide.recompute import RecomputedResult
    from station.sessions.reader import SessionRecord


@command("show", strict=True, as_json=True)
@session_argument
@click.option("--check/--no-check", default=True, help="Hash photographs and results.  [default: check]")
def session_show(name: str, root: Path, check: bool, strict: bool, as_json: bool) -> None:
    """Show the content of SESSION, a folder or a name in --sessions."""
    from station.common.sanitise import printable
    from station.sessions.reader import unknown_files

    record = _read(find_session(name, root))
    click.echo(json.dumps(record.record(), indent=1) if as_json else _words(record))
    for file in unknown_files(record.folder, record.state):
        log("unknown", f"{printable(file)} is not in the journal", level="warning")
    if check:
        from station.common.durable_files import holds
        from station.sessions.layout import SUMS
        from station.sessions.reader import check_whole, sums, verify, verify_results

        with progress(1) as shown:
            shown("hashing photographs and results", 0)
            verify(record.folder, record.state)
            verify_results(record)
            check_whole(record)
            same = holds(record.folder / SUMS, hashlib.sha256(sums(record.folder, record.state)).hexdigest())
        if not same:
            log("unlike", f"{SUMS} differs from the journal; it is rewritten on resume", level="warning")
        count = sum(not shot.lost for shot in record.state.shots)
        log("checked", f"all {count} photographs and all results are unchanged", photographs=count)
    check_strict([result.verdict for result in record.state.results[-1:]], strict=strict)


def _read(folder: Path) -> SessionRecord:
    """The session in a folder, with a warning for every irregularity of its journal."""
    from station.sessions.reader import read_session

    record = read_session(folder)
    for words in record.oddities:
        log("odd", words, level="warning")
    return record


def _words(record: SessionRecord) -> str:
    from station.common.models import listed

    state = record.state
    about = [
        ("session", record.folder.name),
        ("camera", state.camera),
        ("lens", state.lens),
        ("plan", state.plan),
        ("begun", state.began[:19].replace("T", " ") + " UTC"),
        ("steps done", ", ".join(state.done) or "none"),
        ("ended", state.ended or "open"),
    ]
    parts = [columns(about)]
    if state.facts:
        facts = ((name, f"{fact:g}" if isinstance(fact, float) else str(fact)) for name, fact in state.facts.items())
        parts.append(columns([("fact", "value"), *facts]))
    if state.shots:
        counts = {True: "yes", False: "no", None: "not judged"}
        shots = (
            (str(one.number), one.path, one.step, one.purpose, counts[one.counts], one.reason) for one in state.shots
        )
        parts.append(columns([SHOT_HEADING, *shots]))
    if state.results:
        rows = [
            (one.folder, one.step, listed([str(shot) for shot in one.shots]), one.verdict, one.at[:16])
            for one in state.results
        ]
        parts.append(columns([("result", "step", "from shots", "verdict", "at"), *rows]))
    return "\n\n".join(parts)


SHOT_HEADING = ("shot", "file", "step", "purpose", "counts", "why not")


@command("resume", strict=True)
@click.argument("name", metavar="[SESSION]", required=False, shell_complete=completed(session_names))
@sessions_option
@config_option
@inherited("--simulate", is_flag=True, help="Use the simulated bench; the default for a session that began on it.")
@click.option("--without", type=click.IntRange(min=1), multiple=True, help="Discard a shot whose photograph is lost.")
@click.option("--back-to", metavar="STEP", help="Repeat this step and the following ones.")
def session_resume(
    name: str | None, root: Path, config: Path | None, simulate: bool, without: tuple[int, ...], back_to: str | None,
    strict: bool,
) -> None:  # fmt: skip
    """Continue SESSION, or the newest unfinished one, at the first incomplete step; stages home first."""
    from station.cli.guide import Watched, conduct
    from station.guide.workspace import StationLab
    from station.sessions.reader import read_session

    record = read_session(folder := find_session(name, root) if name else newest_unfinished(root))
    if back_to is not None:
        from procedures.outcome import BadParameter
        from station.guide.catalogue import plan_named

        names = [step.name for step in plan_named(record.state.plan).steps]
        if back_to not in names:
            raise BadParameter(
                f"the plan {record.state.plan} has no step {back_to!r}", f"choose one of {', '.join(names)}"
            )
    settings = record.config.get("config", {})
    lab = StationLab(
        sessions=folder.parent,
        config=config or usual_config(),
        simulate=simulate or settings.get("simulate") is True,
        seed=record.state.seed,
    )
    lab.virtual_time = True  # simulated time need not be real: nobody watches the bench
    operator = Watched(sys.stdin, sys.stdout)
    code = conduct(lab, operator, lambda: lab.resume(folder, operator, back_to=back_to, without=without), strict=strict)
    raise click.exceptions.Exit(code)


DIFFERENT = 1


@command("recompute", strict=True, as_json=True)
@session_argument
@click.option("--result", "numbers", type=click.IntRange(min=1), multiple=True, help="Its number; all by default.")
def session_recompute(name: str, root: Path, numbers: tuple[int, ...], strict: bool, as_json: bool) -> None:
    """Recompute the results of SESSION from its photographs and journal, and compare every byte."""
    from station.guide.recompute import recompute

    results, state = [], _read(folder := find_session(name, root)).state
    for one in awaited("recomputing", recompute(folder, numbers)):
        results.append(one)
        _report_recomputed(one)
    if not results:
        log("recomputed", "the session has no result yet", level="warning")
    if as_json:
        entries = [{**asdict(one), "identical": one.identical} for one in results]
        click.echo(json.dumps({"schema": "station/recomputed/1", "results": entries}, indent=1))
    if not all(one.identical for one in results):
        raise click.exceptions.Exit(DIFFERENT)
    if strict:
        verdicts = {result.folder: result.verdict for result in state.results}
        check_strict([verdicts[one.result] for one in results], strict=strict)


SAME_MACHINE = "versions and processor are the same: the program itself has changed since"
ALTERED = "bring these files back from a copy"
AGREE = 0.01
"""Negligible change, as a fraction of the uncertainty."""
HASHES = "files."


def _report_recomputed(one: RecomputedResult) -> None:
    if one.identical:
        how = f", computed with the kernels of {one.kernels}, as then" if one.kernels else ""
        log("recomputed", f"{one.result}: identical, {len(one.same)} files{how}", result=one.result, identical=1)
        return
    files = {"missing or altered": one.altered, "differ": one.different, "missing now": one.missing, "new": one.added}
    from station.common.models import listed

    words = [f"plane {plane} was {then}, is {now}" for plane, then, now in one.verdicts]
    words += _numbers(one)
    words += [f"{what}: {listed(names)}" for what, names in files.items() if names]
    if keys := [key for key in one.keys if not key.startswith(HASHES)]:
        words.append(f"in the record: {listed(keys)}")
    changed = [f"{what} was {then}, is {now}" for what, then, now in one.machine] or [SAME_MACHINE]
    remedy = (
        "; ".join(
            [f"computed by {f'version {one.version}' if one.version else 'a version that was not installed'}", *changed]
        )
        if one.different or one.missing or one.added
        else ALTERED
    )
    log("recomputed", f"{one.result}: {'; '.join(words)}", level="error", remedy=remedy, result=one.result, identical=0)


def _numbers(result: RecomputedResult) -> list[str]:
    if not result.numbers:
        return []
    if not result.moved:
        return [f"its {result.numbers} numbers are the same"]
    largest = result.moved[0]
    words = f"the most {largest.number} of {largest.plane}, {largest.then:.6g} then and {largest.now:.6g} now"
    sigmas = largest.sigmas
    agree = [f"all numbers agree within {abs(sigmas):.2g} of their uncertainties"] if abs(sigmas) < AGREE else []
    return [*agree, f"{len(result.moved)} of {result.numbers} numbers moved, {words}: {sigmas:+.2g} of its uncertainty"]


@command("delete")
@session_argument
@click.option("--yes", is_flag=True, help="Skip the confirmation.")
def session_delete(name: str, root: Path, yes: bool) -> None:
    """Delete SESSION with its photographs and results permanently, after confirmation."""
    from procedures.outcome import BadParameter
    from station.sessions.layout import check_layout
    from station.sessions.reader import delete_session

    folder = find_session(name, root)
    check_layout(folder)
    photographs = sum(1 for path in (folder / "originals").iterdir() if path.is_file())
    if not (yes or click.confirm(f"Delete {folder} with {photographs} photographs permanently?", err=True)):
        raise BadParameter(f"{folder.name} was not deleted", "answer y, or give --yes")
    delete_session(folder)
    log("deleted", f"deleted {folder}", folder=str(folder))


@command("report", strict=True)
@session_argument
@click.option("--out", type=PATH, help="The HTML file.  [default: report.html in the session]")
@certificate_options
@overlay_option
def session_report(
    name: str, root: Path, out: Path | None, overlays: tuple[Path, ...], strict: bool, **given: Any
) -> None:
    """Write the report of SESSION's last result."""
    from station.common.durable_files import write_whole
    from station.guide.session_report import certificate_files, overlaid_page, session_page
    from station.reports.report import PAGE
    from station.results.overlay import read_overlay

    folder, others, details = find_session(name, root), [read_overlay(path) for path in overlays], details_of(given)
    path, state = out or folder / PAGE, _read(folder).state
    with progress(1) as shown:
        shown("drawing the report", 0)
        page = overlaid_page(folder, others) if others else session_page(folder)
    write_whole(path, page.encode())
    log("written", f"wrote {path}", path=str(path))
    for name, data in certificate_files(folder, details=details).items() if details else ():
        write_whole(path.parent / name, data)
        log("written", f"wrote {path.parent / name}", path=str(path.parent / name))
    check_strict([result.verdict for result in state.results[-1:]], strict=strict)
