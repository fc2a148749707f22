"""`station demo`: a whole simulated calibration, without a terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from station.cli.errors import REFUSED
from station.cli.log import log, log_json_option, logs_json

if TYPE_CHECKING:
    from rich.table import Table

    from station.demo import Checked, Demonstration, Summary
    from station.progress import Progress


@click.command("demo")
@click.option(
    "--out", type=click.Path(path_type=Path), default="demo", show_default=True, help="Folder for everything it makes."
)
@click.option("--seed", type=click.IntRange(0, 2**63 - 1), default=1, show_default=True, help="Of the camera's noise.")
@click.option("--json", "as_json", is_flag=True, help="Write result.json to stdout in place of the table.")
@log_json_option
def demo(out: Path, seed: int, as_json: bool) -> None:
    """Photograph the chart with a simulated camera, estimate the PSFs from its files, and compare with the truth."""
    from station.demo import run_demo, steps, summary

    with _progress(steps()) as progress:
        found, text = run_demo(out, seed, progress=progress)
    if as_json:
        click.echo(text, nl=False)
    else:
        _show(found, summary(found))
    log("written", f"wrote {out / 'index.html'}", path=str(out / "index.html"))
    if found.refused:
        raise click.exceptions.Exit(REFUSED)


@contextmanager
def _progress(total: int) -> Iterator[Progress]:
    """A bar where a person watches, lines otherwise."""
    from station.progress import bar

    if sys.stderr.isatty() and not logs_json():
        with bar(total) as progress:
            yield progress
    else:
        yield lambda done, steps=1: log("step", done)


def _show(found: Demonstration, summary: Summary) -> None:
    """The table and its conclusion, on stdout."""
    from rich.console import Console

    console = Console(highlight=False)
    console.print(_table(found))
    if summary.refused < summary.planes:
        console.print(
            f"{summary.passed} of {summary.planes} planes pass. Errors are {summary.ratio_mean:.2f} times the expected "
            f"({summary.ratio_least:.2f} to {summary.ratio_most:.2f}); {summary.mtf50_within} of {summary.mtf50_n} "
            f"MTF50 lie within 2.5 σ of the truth; centres within {summary.centre_px:.4f} pixel."
        )


def _table(found: Demonstration) -> Table:
    """Measured, true, error and bound of every plane."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1))
    table.add_column("photograph", max_width=24)
    table.add_column("")
    for name in ("MTF50 ↔", "true", "MTF50 ↕", "true", "PSF error", "bound"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("", no_wrap=True)
    for number, shot in enumerate(found.shots, 1):
        for i, plane in enumerate(shot.planes):
            title = f"{number} {shot.setup.title}" if i == 0 else ""
            table.add_row(title, *_cells(plane), end_section=i == len(shot.planes) - 1)
    return table


COLOURS = {"pass": "green", "doubtful": "yellow", "refused": "red"}


def _cells(plane: Checked) -> list[str]:
    from station.report import percent, stated

    verdict = str(plane.calibrated.record.verdict)
    coloured = f"[{COLOURS[verdict]}]{verdict}[/]"
    if plane.comparison is None:
        return [plane.name, *[""] * 6, coloured]
    cells = [plane.name]
    for direction in ("horizontal", "vertical"):
        against = plane.comparison.mtf50.get(direction)
        cells += ["", ""] if against is None else [
            stated(against.measured.value, against.measured.uncertainty), f"{against.true:.4f}"
        ]  # fmt: skip
    return [*cells, percent(plane.comparison.error), percent(plane.comparison.expected), coloured]
