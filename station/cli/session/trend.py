"""`station session trend`: drift of a camera."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.cli.result_log import check_strict
from station.cli.session.group import sessions_option
from station.cli.session.list import chosen, filter_options
from station.cli.terminal.columns import columns
from station.cli.terminal.command import StationCommand, json_option, strict_option
from station.common.errors import log, log_json_option
from station.common.sanitise import printable, stated

if TYPE_CHECKING:
    from station.reports.trend import Trend


@click.command("trend", cls=StationCommand)
@click.argument("camera")
@sessions_option
@filter_options
@click.option("--quantity", "quantities", multiple=True, help="[default: mtf50_horizontal and mtf50_vertical]")
@click.option("--out", type=click.Path(path_type=Path), help="Draw it into this file, .svg or .png.")
@strict_option
@json_option
@log_json_option
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
        click.echo(_table(lines))
    else:
        log(
            "trend", f"no session of {camera} has such a number; cameras: {', '.join(known) or 'none'}", level="warning"
        )
    if out is not None:
        _draw(camera, lines, out)
    check_strict(["pass" if one.drifts is False else "doubtful" for one in lines] or [None], strict=strict)


HEADING = ("plane", "quantity", "sessions", "last", "change per year", "by chance", "finding")


LEAST_CHANCE = 1e-3
"""Smallest probability that is given as a number."""


def _table(lines: list[Trend]) -> str:
    """A table for each lens and plan."""
    parts = []
    for (lens, plan), several in itertools.groupby(lines, lambda one: (one.lens, one.plan)):
        rows = list(several)
        units = ", ".join(sorted({one.unit for one in rows}))
        title = printable(f"{lens}, plan {plan}, in {units}")
        parts.append(f"{title}\n{columns([HEADING, *(_row(one) for one in rows)])}")
    return "\n\n".join(parts)


def _row(one: Trend) -> tuple[str, ...]:
    last = stated(one.points[-1].value, one.points[-1].uncertainty)
    slope, chance = "-", "-"
    if one.line is not None:
        slope = stated(one.line.slope, one.line.slope_uncertainty)
        chance = f"{one.line.p_value:.2g}" if one.line.p_value >= LEAST_CHANCE else f"< {LEAST_CHANCE:g}"
    return one.plane, one.quantity, str(len(one.points)), last, slope, chance, one.finding


def _draw(camera: str, lines: list[Trend], out: Path) -> None:
    from station.common.durable_files import write_whole
    from station.reports.trend_figure import trend_picture

    write_whole(out, trend_picture(camera, lines, out))
    log("written", f"wrote {out}", path=str(out))


def _record(camera: str, lines: list[Trend]) -> dict[str, Any]:
    from dataclasses import asdict

    from station.results.result_files import plain

    def entry(one: Trend) -> dict[str, Any]:
        line = None if one.line is None else asdict(one.line)
        points = [
            {"session": p.folder.name, "began": p.began, "value": p.value, "uncertainty": p.uncertainty}
            for p in one.points
        ]
        names = ("lens", "plan", "plane", "quantity", "unit", "drifts", "finding")
        return {**{name: getattr(one, name) for name in names}, "points": points, "line": line}

    record: dict[str, Any] = plain(
        {"schema": "station/trend/1", "camera": camera, "trends": [entry(one) for one in lines]}
    )
    return record
