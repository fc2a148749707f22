"""`station session show`: content of a session, verified."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from station.cli.result_log import check_strict
from station.cli.session.group import find_session, session_argument
from station.cli.terminal.columns import columns
from station.cli.terminal.command import StationCommand, json_option, strict_option
from station.cli.terminal.progress import progress
from station.common.errors import log, log_json_option

if TYPE_CHECKING:
    from station.sessions.reader import SessionRecord
    from station.sessions.state import SessionShot


@click.command("show", cls=StationCommand)
@session_argument
@click.option("--check/--no-check", default=True, help="Hash photographs and results.  [default: check]")
@strict_option
@json_option
@log_json_option
def session_show(name: str, root: Path, check: bool, strict: bool, as_json: bool) -> None:
    """Show the content of SESSION, a folder or a name in --sessions."""
    from station.common.sanitise import printable
    from station.sessions.reader import read_session, unknown_files

    record = read_session(find_session(name, root))
    click.echo(json.dumps(record.record(), indent=1) if as_json else _words(record))
    for words in record.oddities:
        log("odd", words, level="warning")
    for file in unknown_files(record.folder, record.state):
        log("unknown", f"{printable(file)} is not in the journal", level="warning")
    if check:
        with progress(1) as shown:
            shown("hashing photographs and results", 0)
            same = _sums_agree(record)
        _log_check(record, sums_agree=same)
    check_strict([one.verdict for one in record.state.results[-1:]], strict=strict)


def _sums_agree(record: SessionRecord) -> bool:
    """Compare photographs and results with the journal; whether the list of sums is that of the journal. Raises
    Damaged."""
    from station.common.durable_files import holds
    from station.sessions.layout import SUMS
    from station.sessions.reader import check_whole, sums, verify, verify_results

    verify(record.folder, record.state)
    verify_results(record)
    check_whole(record)
    return holds(record.folder / SUMS, hashlib.sha256(sums(record.folder, record.state)).hexdigest())


def _log_check(record: SessionRecord, *, sums_agree: bool) -> None:
    from station.sessions.layout import SUMS

    if not sums_agree:
        log("unlike", f"{SUMS} differs from the journal; it is rewritten on resume", level="warning")
    count = sum(not shot.lost for shot in record.state.shots)
    log("checked", f"all {count} photographs and all results are unchanged", photographs=count)


def _words(record: SessionRecord) -> str:
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
        parts.append(columns([("fact", "value"), *((name, _value(fact)) for name, fact in state.facts.items())]))
    if state.shots:
        parts.append(columns([SHOT_HEADING, *(_shot_row(shot) for shot in state.shots)]))
    if state.results:
        rows = [
            (one.folder, one.step, " ".join(map(str, one.shots)), one.verdict, one.at[:16]) for one in state.results
        ]
        parts.append(columns([("result", "step", "from shots", "verdict", "at"), *rows]))
    return "\n\n".join(parts)


SHOT_HEADING = ("shot", "file", "step", "purpose", "counts", "why not")


def _shot_row(shot: SessionShot) -> tuple[str, ...]:
    counts = {True: "yes", False: "no", None: "not judged"}[shot.counts]
    return str(shot.number), shot.path, shot.step, shot.purpose, counts, shot.reason


def _value(fact: object) -> str:
    return f"{fact:g}" if isinstance(fact, float) else str(fact)
