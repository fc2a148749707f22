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
KEYS_TOLD = 8


def _tell(one: Comparison) -> None:
    if one.identical:
        how = f", computed with the kernels of {one.kernels}, as then" if one.kernels else ""
        log("recomputed", f"{one.result}: identical, {len(one.same)} files{how}", result=one.result, identical=1)
        return
    told = {"differ": one.different, "are missing now": one.missing, "are new": one.added}
    words = [f"{', '.join(names)} {what}" for what, names in told.items() if names]
    if one.keys:
        more = f" and {len(one.keys) - KEYS_TOLD} more" if len(one.keys) > KEYS_TOLD else ""
        words.append(f"in the record: {', '.join(one.keys[:KEYS_TOLD])}{more}")
    words += [f"plane {plane} was {then}, is {now}" for plane, then, now in one.verdicts]
    words += _numbers(one)
    changed = [f"{what} was {then}, is {now}" for what, then, now in one.machine] or [SAME_MACHINE]
    remedy = "; ".join(
        [f"drawn by {f'version {one.version}' if one.version else 'a version that was not installed'}", *changed]
    )
    log("recomputed", f"{one.result}: {'; '.join(words)}", level="error", remedy=remedy, result=one.result, identical=0)


def _numbers(one: Comparison) -> list[str]:
    """How far the numbers went, measured by their own uncertainties."""
    if not one.numbers:
        return []
    if not one.moved:
        return [f"its {one.numbers} numbers are the same"]
    far = one.moved[0]
    words = f"the most {far.number} of {far.plane}, {far.then:.6g} then and {far.now:.6g} now"
    return [f"{len(one.moved)} of {one.numbers} numbers moved, {words}: {far.sigmas:+.2g} of its uncertainty"]
