"""`station session recompute`: recompute results and compare them byte by byte."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from station.cli.result_log import check_strict
from station.cli.session.group import find_session, session_argument
from station.cli.terminal.command import StationCommand, json_option, strict_option
from station.cli.terminal.progress import awaited
from station.common.errors import log, log_json_option

if TYPE_CHECKING:
    from station.guide.recompute import RecomputedResult

DIFFERENT = 1
"""Exit code for a difference."""


@click.command("recompute", cls=StationCommand)
@session_argument
@click.option("--result", "numbers", type=click.IntRange(min=1), multiple=True, help="Its number; all by default.")
@strict_option
@json_option
@log_json_option
def session_recompute(name: str, root: Path, numbers: tuple[int, ...], strict: bool, as_json: bool) -> None:
    """Recompute the results of SESSION from its photographs and journal, and compare every byte."""
    from station.guide.recompute import recompute
    from station.sessions.reader import read_session

    results = []
    for one in awaited("recomputing", recompute(folder := find_session(name, root), numbers)):
        results.append(one)
        _report(one)
    if not results:
        log("recomputed", "the session has no result yet", level="warning")
    if as_json:
        entries = [{**asdict(one), "identical": one.identical} for one in results]
        click.echo(json.dumps({"schema": "station/recomputed/1", "results": entries}, indent=1))
    if not all(one.identical for one in results):
        raise click.exceptions.Exit(DIFFERENT)
    if strict:
        verdicts = {result.folder: result.verdict for result in read_session(folder).state.results}
        check_strict([verdicts[one.result] for one in results], strict=strict)


SAME_MACHINE = "versions and processor are the same: the program itself has changed since, or the result was altered"
AGREE = 0.01
"""Negligible change, as a fraction of the uncertainty."""
LISTED = 6
"""Number of files and entries that are listed."""
HASHES = "files."
"""Prefix of a record's entries with the hashes of its files."""


def _report(one: RecomputedResult) -> None:
    if one.identical:
        how = f", computed with the kernels of {one.kernels}, as then" if one.kernels else ""
        log("recomputed", f"{one.result}: identical, {len(one.same)} files{how}", result=one.result, identical=1)
        return
    files = {"differ": one.different, "missing now": one.missing, "new": one.added}
    words = [f"plane {plane} was {then}, is {now}" for plane, then, now in one.verdicts]
    words += _numbers(one)
    words += [f"{what}: {_some(names)}" for what, names in files.items() if names]
    if keys := [key for key in one.keys if not key.startswith(HASHES)]:
        words.append(f"in the record: {_some(keys)}")
    changed = [f"{what} was {then}, is {now}" for what, then, now in one.machine] or [SAME_MACHINE]
    remedy = "; ".join(
        [f"computed by {f'version {one.version}' if one.version else 'a version that was not installed'}", *changed]
    )
    log("recomputed", f"{one.result}: {'; '.join(words)}", level="error", remedy=remedy, result=one.result, identical=0)


def _some(names: Sequence[str]) -> str:
    """The first names, and the number of others."""
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return f"{', '.join(names[:LISTED])}{more}"


def _numbers(one: RecomputedResult) -> list[str]:
    """Changes of the numbers relative to their uncertainties."""
    if not one.numbers:
        return []
    if not one.moved:
        return [f"its {one.numbers} numbers are the same"]
    largest = one.moved[0]
    words = f"the most {largest.number} of {largest.plane}, {largest.then:.6g} then and {largest.now:.6g} now"
    sigmas = largest.sigmas
    agree = [f"all numbers agree within {abs(sigmas):.2g} of their uncertainties"] if abs(sigmas) < AGREE else []
    return [*agree, f"{len(one.moved)} of {one.numbers} numbers moved, {words}: {sigmas:+.2g} of its uncertainty"]
