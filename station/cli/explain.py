"""`station explain`: why a result is as it is, and what would improve it most."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.cli.result_log import check_strict
from station.cli.terminal.command import command
from station.cli.terminal.progress import progress

if TYPE_CHECKING:
    from station.results.explanation import CauseCount, PlaneExplanation

MOST_TERMS = 3


@command("explain", strict=True, as_json=True)
@click.argument("result", type=click.Path(path_type=Path))
@click.option("--twin", is_flag=True, help="Predict the effect of remedies by a simulated camera (some seconds).")
def explain(result: Path, twin: bool, strict: bool, as_json: bool) -> None:
    """Explain RESULT, a result, session or batch: most likely cause, largest uncertainty, best remedy."""
    from station.results.explanation import explain_batch, explain_result, is_batch, read_explained, result_folder

    if is_batch(folder := result_folder(result)):
        causes = explain_batch(folder)
        _write({"result": str(folder), "causes": [asdict(one) for one in causes]}, _batch_lines(causes), as_json)
        check_strict((None for _ in causes), strict=strict)
        return
    folder, measurement = read_explained(result)
    planes = explain_result(measurement)
    entry: dict[str, Any] = {"result": str(folder), "planes": [asdict(one) for one in planes]}
    lines = [line for one in planes for line in _plane_lines(one)]
    if twin:
        from station.demo.digital_twin import predictions

        first = planes[0]
        with progress(1) as shown:
            shown("photographing with the digital twin", 0)
            effects = predictions(measurement.by_name[first.plane].details)
        entry["twin"] = [asdict(one) for one in effects]
        lines += ["", f"By the digital twin, for {first.plane}:"]
        lines += [f"  {one.words}: MTF50 ± {first.uncertainty:.2g} becomes ± {one.uncertainty:.2g}" for one in effects]
    _write(entry, lines, as_json)
    check_strict((one.verdict for one in planes), strict=strict)


def _write(entry: dict[str, Any], lines: Sequence[str], as_json: bool) -> None:
    click.echo(json.dumps(entry, indent=1) if as_json else "\n".join(lines))


def _plane_lines(one: PlaneExplanation) -> list[str]:
    from procedures.choice import TERMS
    from procedures.numbers import label

    lines = [f"{one.plane}: {one.verdict}" + (f", because {one.reason}" if one.reason else "")]
    lines += [f"  what helps: {one.remedy}"] if one.remedy else []
    if one.terms:
        lines.append(f"  {label(one.number)} {one.value}; the parts of its variance:")
    for part in one.terms[:MOST_TERMS]:
        lines.append(f"    {part.share:4.0%} {TERMS[part.term]}; to ± {part.uncertainty_then:.2g}: {part.remedy}")
    return lines


def _batch_lines(causes: Sequence[CauseCount]) -> list[str]:
    if not causes:
        return ["every photograph passed"]
    return [line for one in causes for line in (f"{one.count:6d}  {one.reason}", f"        what helps: {one.remedy}")]
