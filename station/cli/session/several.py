"""`station session list`, `trend` and `index`: all sessions of a folder."""

from __future__ import annotations

import itertools
import json
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.cli.result_log import check_strict
from station.cli.session.group import sessions_option
from station.cli.terminal.command import PATH, columns, command, completed, options, plan_names
from station.common.errors import log
from station.common.sanitise import printable, stated

if TYPE_CHECKING:
    from station.reports.trend import Trend
    from station.sessions.index import Filter, IndexEntry

VERDICTS = ("pass", "doubtful", "refused")


filter_options = options(
    click.option("--lens", help="Only sessions with this lens."),
    click.option("--plan", shell_complete=completed(plan_names), help="Only sessions of this plan."),
    click.option("--since", metavar="DATE", help="Only sessions since this date: 2026-03-14."),
)


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


@command("list", strict=True, as_json=True)
@sessions_option
@click.option("--camera", help="Only sessions of this camera.")
@filter_options
@click.option("--verdict", type=click.Choice(VERDICTS), help="Only sessions whose last result has this verdict.")
def session_list(root: Path, strict: bool, as_json: bool, **wanted: Any) -> None:
    """List the sessions, newest first."""
    from station.sessions.index import Index

    with Index(root) as index:
        entries = index.sessions(chosen(**wanted))
    if as_json:
        click.echo(
            json.dumps({"schema": "station/sessions/1", "sessions": [entry.record() for entry in entries]}, indent=1)
        )
    elif entries:
        click.echo(columns([HEADING, *(_row(entry) for entry in entries)]))
    else:
        log("sessions", f"no session in {root} matches", root=str(root))
    for entry in entries:
        if entry.damage:
            log("damaged", f"{entry.folder.name}: {entry.damage}", level="warning", folder=str(entry.folder))
    check_strict([entry.verdict for entry in entries], strict=strict)


HEADING = ("session", "begun", "camera", "lens", "plan", "shots", "ended", "verdict")


def _row(entry: IndexEntry) -> tuple[str, ...]:
    if entry.damage and not entry.began:
        return entry.folder.name, "-", "-", "-", "-", "-", "-", "damaged"
    shots = f"{entry.counting} of {entry.shots}"
    verdict = "damaged" if entry.damage else entry.verdict or "-"
    words = (entry.camera, entry.lens, entry.plan, shots, entry.ended or "open", verdict)
    return entry.folder.name, entry.began[:16].replace("T", " "), *words


@command("trend", strict=True, as_json=True)
@click.argument("camera")
@sessions_option
@filter_options
@click.option("--quantity", "quantities", multiple=True, help="[default: mtf50_horizontal and mtf50_vertical]")
@click.option("--out", type=PATH, help="Draw it into this file, .svg or .png.")
def session_trend(
    camera: str, root: Path, quantities: tuple[str, ...], out: Path | None, strict: bool, as_json: bool, **wanted: Any
) -> None:
    """Report the change over time of the numbers of CAMERA, as named in its sessions.

    With --strict it exits with 1 if a number drifts, or has too few sessions for a finding.
    """
    from station.reports.trend import QUANTITIES, trends
    from station.sessions.index import Index

    with Index(root) as index:
        lines = trends(index.measured(chosen(camera=camera, **wanted), quantities or QUANTITIES))
        known = index.names("cameras")
    if as_json:
        click.echo(json.dumps(_record(camera, lines), indent=1))
    elif lines:
        parts = []
        for (lens, plan), several in itertools.groupby(lines, lambda one: (one.lens, one.plan)):
            rows = list(several)
            units = ", ".join(sorted({row.unit for row in rows}))
            title = printable(f"{lens}, plan {plan}, in {units}")
            parts.append(f"{title}\n{columns([TREND_HEADING, *(_trend_row(row) for row in rows)])}")
        click.echo("\n\n".join(parts))
    else:
        log(
            "trend", f"no session of {camera} has such a number; cameras: {', '.join(known) or 'none'}", level="warning"
        )
    if out is not None:
        from station.common.durable_files import write_whole
        from station.reports.trend_figure import trend_picture

        write_whole(out, trend_picture(camera, lines, out))
        log("written", f"wrote {out}", path=str(out))
    check_strict(["pass" if line.drifts is False else "doubtful" for line in lines] or [None], strict=strict)


TREND_HEADING = ("plane", "quantity", "sessions", "last", "change per year", "by chance", "finding")


LEAST_CHANCE = 1e-3
"""Smallest probability that is given as a number."""


def _trend_row(trend: Trend) -> tuple[str, ...]:
    last = stated(trend.points[-1].value, trend.points[-1].uncertainty)
    slope, chance = "-", "-"
    if trend.line is not None:
        slope = stated(trend.line.slope, trend.line.slope_uncertainty)
        chance = f"{trend.line.p_value:.2g}" if trend.line.p_value >= LEAST_CHANCE else f"< {LEAST_CHANCE:g}"
    return trend.plane, trend.quantity, str(len(trend.points)), last, slope, chance, trend.finding


def _record(camera: str, lines: list[Trend]) -> dict[str, Any]:
    from station.results.result_files import plain

    def entry(trend: Trend) -> dict[str, Any]:
        line = None if trend.line is None else asdict(trend.line)
        points = [
            {"session": p.folder.name, "began": p.began, "value": p.value, "uncertainty": p.uncertainty}
            for p in trend.points
        ]
        names = ("lens", "plan", "plane", "quantity", "unit", "drifts", "finding")
        return {**{name: getattr(trend, name) for name in names}, "points": points, "line": line}

    record: dict[str, Any] = plain(
        {"schema": "station/trend/1", "camera": camera, "trends": [entry(one) for one in lines]}
    )
    return record


@command("index")
@sessions_option
@click.option("--rebuild", is_flag=True, help="Discard it and read every session.")
def session_index(root: Path, rebuild: bool) -> None:
    """Update the index of the sessions. It is derived from their folders and may be rebuilt."""
    from station.sessions.index import Index

    with Index(root, rebuild=rebuild) as index:
        entries, cameras, lenses = index.sessions(), index.names("cameras"), index.names("lenses")
    damaged = sum(bool(entry.damage) for entry in entries)
    sentence = f"{len(entries)} sessions, {len(cameras)} cameras, {len(lenses)} lenses; {damaged} sessions are damaged"
    log("index", sentence, sessions=len(entries), cameras=len(cameras), lenses=len(lenses), damaged=damaged)
