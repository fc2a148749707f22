"""What the commands share that turn photographs into PSFs: their options, reading, telling."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.cli.psf.terms import tell_specification
from station.cli.terminal.numbers import SEED
from station.common.errors import REFUSED
from station.common.log import Fact, log

if TYPE_CHECKING:
    from procedures.outcome import Judged, Miss
    from procedures.pattern_print.source import Source
    from station.results.overlay import Overlay
    from station.results.plane_result import PlaneResult

LEVELS = {"pass": "info", "doubtful": "warning", "refused": "error"}
"""Of a log line, by verdict."""
FAILED = 1
"""Exit code: measured, and not good enough."""

Command = Callable[..., Any]


certificate_option = click.option(
    "--certificate", is_flag=True, help="Write certificate.html and certificate.pdf too: one printed page."
)


overlay_option = click.option(
    "--overlay", "overlays", multiple=True, type=click.Path(path_type=Path), metavar="RESULT",
    help="Draw the MTF of this result or session over the page's too; as often as wanted.",
)  # fmt: skip


jobs_option = click.option(
    "--jobs", type=click.IntRange(1, 1024), help="Processes at a time.  [default: as many as cores]"
)


def read_overlays(paths: Sequence[Path]) -> list[Overlay]:
    """The results to draw over this one's. Raises BadParameter where one is none."""
    from station.results.overlay import read_overlay

    return [read_overlay(path) for path in paths]


def chart_options(command: Command) -> Command:
    """The options that tell which chart was printed."""
    bits = click.option("--bits", type=click.Path(path_type=Path), help="The chart's 256 x 256 cells as a grey image.")
    seed = click.option("--seed", type=SEED, help="The chart's seed; 1 if neither this nor --bits is given.")
    return bits(seed(command))


def chart_source(bits: Path | None, seed: int | None) -> Source:
    """The chart that the options tell."""
    if bits is not None and seed is not None:
        raise click.UsageError("the chart comes from --bits or from --seed; give one of them")
    from procedures.pattern import DEFAULT_SEED
    from procedures.pattern_print.source import Source

    return Source.from_file(bits) if bits else Source.from_seed(DEFAULT_SEED if seed is None else seed)


def finish(records: Sequence[PlaneResult], text: str, *, as_json: bool) -> None:
    """Tell how the planes stand to their specification, and write the record to stdout where it is wanted.

    Leaves with the code of a refusal if a plane was refused, else with that of a failure if one does not meet its
    specification.
    """
    tell_specification(records)
    if as_json:
        click.echo(text, nl=False)
    if any(record.verdict == "refused" for record in records):
        raise click.exceptions.Exit(REFUSED)
    if any(record.specification and record.specification.judged == "does not meet" for record in records):
        raise click.exceptions.Exit(FAILED)


def tell_result(record: PlaneResult) -> None:
    """One line on stderr about a plane."""
    took = {"dur_ms": round(1000 * record.duration_s)} if record.duration_s else {}
    tell_judged("plane", _sentence(record), record, plane=record.name, **took)
    tell_untold(record)


def tell_judged(event: str, sentence: str, judged: Judged, **facts: Fact) -> None:
    """One line on stderr about a result, with the causes of its verdict."""
    log(
        event,
        sentence,
        level=LEVELS[str(judged.verdict)],
        remedy=judged.remedy,
        other_causes=judged.other_causes,
        verdict=str(judged.verdict),
        **facts,
    )


def tell_untold(record: PlaneResult) -> None:
    """A line on stderr for every frequency asked for at which a plane has no MTF."""
    for sentence in record.untold:
        log("untold", f"{record.name}: {sentence}", level="warning", plane=record.name)


def tell_misses(misses: Iterable[Miss]) -> None:
    """Which places of which photographs gave nothing, each with its reason."""
    for miss in misses:
        log("missed", str(miss), level="warning", remedy=miss.remedy)


def _sentence(record: PlaneResult) -> str:
    """What a person wants to know of a plane in one line."""
    from procedures.numbers import RADIAL, Group, frequency_of, in_group, label
    from station.common.uncertainty_text import stated
    from station.results.verdict_words import measurement_words

    parts = [f"{record.name}: {measurement_words(record.verdict)}"]
    parts += [record.reason] if record.reason else []
    asked = [name for name in record.numbers if (at := frequency_of(name)) and at[1] != RADIAL]
    for name in (*in_group(Group.LINE, {**record.numbers, **record.values}), *asked):
        if (number := record.quantity(name)) is None:
            continue
        words = f"{label(name, record.unit)} {stated(number.value, number.uncertainty)}"
        parts.append(f"{words} {number.unit}" if number.unit != "1" else words)
    if record.unit == "cycles/pixel" and record.pitch > 1 and any("pixel" in part for part in parts):
        parts.append(f"pixels of the plane, each {record.pitch} of the sensor")
    return "; ".join(parts)
