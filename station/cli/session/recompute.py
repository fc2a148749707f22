"""`station session recompute`: its results again, compared byte for byte."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from station.cli.session.group import find_session, session_argument
from station.common.log import log, log_json_option

if TYPE_CHECKING:
    from station.guide.recompute import RecomputedResult

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
AGREE = 0.01
"""Of a number's uncertainty: by less nobody would tell two results apart."""
TOLD = 6
"""Files and entries that are named, of many."""
HASHES = "files."
"""Entries of a record that say what its files already say."""


def _tell(one: RecomputedResult) -> None:
    if one.identical:
        how = f", computed with the kernels of {one.kernels}, as then" if one.kernels else ""
        log("recomputed", f"{one.result}: identical, {len(one.same)} files{how}", result=one.result, identical=1)
        return
    told = {"differ": one.different, "missing now": one.missing, "new": one.added}
    words = [f"plane {plane} was {then}, is {now}" for plane, then, now in one.verdicts]
    words += _numbers(one)
    words += [f"{what}: {_some(names)}" for what, names in told.items() if names]
    if keys := [key for key in one.keys if not key.startswith(HASHES)]:
        words.append(f"in the record: {_some(keys)}")
    changed = [f"{what} was {then}, is {now}" for what, then, now in one.machine] or [SAME_MACHINE]
    remedy = "; ".join(
        [f"drawn by {f'version {one.version}' if one.version else 'a version that was not installed'}", *changed]
    )
    log("recomputed", f"{one.result}: {'; '.join(words)}", level="error", remedy=remedy, result=one.result, identical=0)


def _some(names: Sequence[str]) -> str:
    """The first of some names, and how many more there are."""
    more = f" and {len(names) - TOLD} more" if len(names) > TOLD else ""
    return f"{', '.join(names[:TOLD])}{more}"


def _numbers(one: RecomputedResult) -> list[str]:
    """How far the numbers went, measured by their own uncertainties."""
    if not one.numbers:
        return []
    if not one.moved:
        return [f"its {one.numbers} numbers are the same"]
    far = one.moved[0]
    words = f"the most {far.number} of {far.plane}, {far.then:.6g} then and {far.now:.6g} now"
    agree = (
        [f"all numbers agree within {abs(far.sigmas):.2g} of their uncertainties"] if abs(far.sigmas) < AGREE else []
    )
    return [*agree, f"{len(one.moved)} of {one.numbers} numbers moved, {words}: {far.sigmas:+.2g} of its uncertainty"]
