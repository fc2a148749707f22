"""`station session list`: the sessions, newest first."""

from __future__ import annotations

import json
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.cli.result_log import check_strict
from station.cli.session.group import sessions_option
from station.cli.terminal.columns import columns
from station.cli.terminal.command import StationCommand, json_option, strict_option
from station.common.errors import log, log_json_option

if TYPE_CHECKING:
    from station.sessions.index import Filter, IndexEntry

VERDICTS = ("pass", "doubtful", "refused")


def filter_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """The options that choose sessions."""
    options = (
        click.option("--lens", help="Only sessions with this lens."),
        click.option("--plan", help="Only sessions of this plan."),
        click.option("--since", metavar="DATE", help="Only sessions since this date: 2026-03-14."),
    )
    for option in reversed(options):
        command = option(command)
    return command


def chosen(since: str | None, **others: str | None) -> Filter:
    """The filter of these options. Raises BadParameter for an invalid date."""
    from procedures.outcome import BadParameter
    from station.common.sanitise import encodable
    from station.sessions.index import Filter

    if since is not None:
        try:
            moment = datetime.fromisoformat(since)
        except ValueError as error:
            raise BadParameter(f"--since requires a date; got {since!r}", "write it as 2026-03-14") from error
        since = (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).astimezone(UTC).isoformat()
    wanted = {name: None if value is None else encodable(value) for name, value in others.items()}
    return Filter(since=since, **wanted)


@click.command("list", cls=StationCommand)
@sessions_option
@click.option("--camera", help="Only sessions of this camera.")
@filter_options
@click.option("--verdict", type=click.Choice(VERDICTS), help="Only sessions whose last result has this verdict.")
@strict_option
@json_option
@log_json_option
def session_list(root: Path, strict: bool, as_json: bool, **wanted: Any) -> None:
    """List the sessions, newest first."""
    from station.sessions.index import Index

    with Index(root) as index:
        entries = index.sessions(chosen(**wanted))
    if as_json:
        click.echo(
            json.dumps({"schema": "station/sessions/1", "sessions": [one.record() for one in entries]}, indent=1)
        )
    elif entries:
        click.echo(columns([HEADING, *(_row(one) for one in entries)]))
    else:
        log("sessions", f"no session in {root} matches", root=str(root))
    for one in entries:
        if one.damage:
            log("damaged", f"{one.folder.name}: {one.damage}", level="warning", folder=str(one.folder))
    check_strict([one.verdict for one in entries], strict=strict)


HEADING = ("session", "begun", "camera", "lens", "plan", "shots", "ended", "verdict")


def _row(one: IndexEntry) -> tuple[str, ...]:
    if one.damage and not one.began:
        return one.folder.name, "-", "-", "-", "-", "-", "-", "damaged"
    shots = f"{one.counting} of {one.shots}"
    verdict = "damaged" if one.damage else one.verdict or "-"
    words = (one.camera, one.lens, one.plan, shots, one.ended or "open", verdict)
    return one.folder.name, one.began[:16].replace("T", " "), *words
