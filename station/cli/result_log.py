"""Log lines about the results of a command, and its exit code."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import click

from station.common.errors import REFUSED, log
from station.common.sanitise import printable

if TYPE_CHECKING:
    from station.results.plane_result import PlaneResult

LEVELS = {"pass": "info", "doubtful": "warning", "refused": "error"}
SPECIFICATION_LEVELS = {"meets": "info", "undecided": "warning", "does not meet": "error"}
FAILED = 1


def log_result(record: PlaneResult) -> None:
    """Log a plane with its verdict and numbers, and the requested frequencies without an MTF."""
    took = {"dur_ms": round(1000 * record.duration_s)} if record.duration_s else {}
    from station.results.comparison import measurement_words
    from station.results.plane_result import line_numbers

    parts = [f"{record.name}: {measurement_words(record.verdict)}"]
    parts += [record.reason] if record.reason else []
    parts += line_numbers(record)
    if record.unit == "cycles/pixel" and record.pitch > 1 and any("pixel" in part for part in parts):
        parts.append(f"pixels of the plane, each {record.pitch} of the sensor")
    log(
        "plane", "; ".join(parts), level=LEVELS[str(record.verdict)], remedy=record.remedy,
        other_causes=record.other_causes, verdict=str(record.verdict), plane=record.name, **took,
    )  # fmt: skip
    for sentence in record.unavailable:
        log("unavailable", f"{record.name}: {sentence}", level="warning", plane=record.name)


def check_strict(verdicts: Iterable[str | None], *, strict: bool) -> None:
    """Exit with 1 if `strict` and one of the verdicts is not a pass."""
    if strict and any(verdict != "pass" for verdict in verdicts):
        raise click.exceptions.Exit(FAILED)


def finish(records: Sequence[PlaneResult], text: str, *, as_json: bool, strict: bool = False) -> None:
    """Log the verdicts against the specification, write the record to stdout if requested, and exit.

    The exit code is that of a refusal if a plane was refused, else 1 if one misses its specification, or, where that
    is `strict`, is doubtful, undecided, or compared with no limit at all.
    """
    from station.results.comparison import specification_words

    for one in records:
        comparison = one.specification
        if comparison is None or comparison.judged is None:
            continue
        words = [f"{one.name}: {specification_words(comparison.judged)}", *map(printable, comparison.against)]
        verdict = str(comparison.judged)
        log(
            "specification", "; ".join(words), level=SPECIFICATION_LEVELS[verdict], plane=one.name,
            specification=verdict,
        )  # fmt: skip
    judged = {record.specification.judged for record in records if record.specification}
    if judged == {None}:
        missing = f"no limit of the specification holds for {', '.join(record.name for record in records)}"
        log("specification", missing, level="warning", remedy="name these planes in it, or measure those that it names")
    if as_json:
        click.echo(text, nl=False)
    if any(record.verdict == "refused" for record in records):
        raise click.exceptions.Exit(REFUSED)
    unsure = any(record.verdict != "pass" for record in records) or "undecided" in judged or judged == {None}
    if "does not meet" in judged or (strict and unsure):
        raise click.exceptions.Exit(FAILED)
