"""`station session recompute`: its results again, compared byte for byte."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from station.cli.session.group import find_session, session_argument
from station.common.log import log, log_json_option

if TYPE_CHECKING:
    from station.guide.recompute import Comparison

DIFFERENT = 1
"""The exit code where a file differs."""


@click.command("recompute")
@session_argument
@click.option("--result", "numbers", type=click.IntRange(min=1), multiple=True, help="Its number; all by default.")
@click.option("--json", "as_json", is_flag=True, help="Write the comparison as JSON to stdout.")
@log_json_option
def session_recompute(name: str, root: Path, numbers: tuple[int, ...], as_json: bool) -> None:
    """Compute the results of SESSION again from its photographs and journal, and compare every byte."""
    from station.guide.recompute import recompute

    found = []
    for one in recompute(find_session(name, root), numbers):
        found.append(one)
        _tell(one)
    if not found:
        log("recomputed", "the session has no result yet", level="warning")
    if as_json:
        told = [{**asdict(one), "identical": one.identical} for one in found]
        click.echo(json.dumps({"schema": "station/recomputed/1", "results": told}, indent=1))
    if not all(one.identical for one in found):
        raise click.exceptions.Exit(DIFFERENT)


SAME_MACHINE = "versions and processor are the same: the program itself has changed since, or the result was altered"


def _tell(one: Comparison) -> None:
    if one.identical:
        how = f", computed with the kernels of {one.kernels}, as then" if one.kernels else ""
        log("recomputed", f"{one.result}: identical, {len(one.same)} files{how}", result=one.result, identical=1)
        return
    told = {"differ": one.different, "are missing now": one.missing, "are new": one.added}
    words = [f"{', '.join(names)} {what}" for what, names in told.items() if names]
    words += [f"in the record: {', '.join(one.keys[:8])}"] if one.keys else []
    remedy = "; ".join(f"{what} was {then}, is {now}" for what, then, now in one.machine) or SAME_MACHINE
    log("recomputed", f"{one.result}: {'; '.join(words)}", level="error", remedy=remedy, result=one.result, identical=0)
