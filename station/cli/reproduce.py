"""`station reproduce`: the papers' tables and figures, computed again."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import click

from station.cli.result_log import check_strict
from station.cli.terminal.command import PATH, command, completed
from station.cli.terminal.progress import progress as progress_shown
from station.common.errors import log
from station.drawing.colours import TERMINAL_COLOURS

if TYPE_CHECKING:
    from rich.table import Table

    from station.demo.reproduce.runner import Reproduction

DISAGREES = 1


def _rows(ctx: click.Context) -> list[str]:
    from station.demo.reproduce.catalogue import ROWS

    return [row.name for row in ROWS]


@command("reproduce", strict=True, as_json=True)
@click.argument("name", required=False, shell_complete=completed(_rows))
@click.option("--full", is_flag=True, help="Include the slow rows.")
@click.option("--out", type=PATH, required=True, help="Folder for page and record.")
@click.option(
    "--data", type=click.Path(path_type=Path, file_okay=False), envvar="STATION_SHARED_DATA", show_envvar=True,
    help="Folder of published photographs and films; without it the rows that need it are not computed.",
)  # fmt: skip
@click.option(
    "--fetch",
    is_flag=True,
    help="Download missing photographs from the authors' repositories, and render missing films.",
)
def reproduce(
    name: str | None, full: bool, out: Path, data: Path | None, fetch: bool, strict: bool, as_json: bool
) -> None:
    """Reproduce the papers' tables and figures: all, or the row or chapter NAME; an unknown NAME lists them.

    A row is "reproduced" (every value is within the paper's own claim), has the "same direction" (the order that the
    paper states holds, values differ) or is "not reproduced". Returns 1 when a row is not reproduced or none was
    computed, 0 otherwise; with --strict, 1 when any row is not reproduced in full.
    """
    from procedures.outcome import BadParameter
    from station.demo.reproduce.catalogue import PUBLISHED_FILES, ROWS
    from station.demo.reproduce.catalogue import fetch as fetch_files
    from station.demo.reproduce.row import Setting
    from station.demo.reproduce.runner import PAGE, select
    from station.demo.reproduce.runner import reproduce as run

    if fetch and data is None:
        raise BadParameter("--fetch needs a folder", "name it with --data; it is created")
    if data is not None and not fetch and not data.is_dir():
        raise BadParameter(f"--data needs a folder; there is no {data}", "add --fetch to create it")
    threads = os.cpu_count() or 1
    if fetch and data is not None:
        with progress_shown(len(PUBLISHED_FILES)) as progress:
            fetch_files(data, PUBLISHED_FILES, threads=threads, progress=progress)
    setting = Setting(data, full, threads)
    with progress_shown(len(select(ROWS, name))) as progress:
        result, text = run(out, ROWS, setting, name=name, progress=progress)
    if as_json:
        click.echo(text, nl=False)
    else:
        from rich.console import Console

        Console().print(_table(result))
        click.echo(f"It took {result.seconds:.0f} s, and {result.processor_s:.0f} s of processor.")
    log("written", f"wrote {out / PAGE}", path=str(out / PAGE))
    if not result.agrees:
        raise click.exceptions.Exit(DISAGREES)
    check_strict(("pass" if row.state == "reproduced" else "doubtful" for row in result.rows), strict=strict)


def _table(result: Reproduction) -> Table:
    """One line for each row, and below it each value that is outside the paper's claim."""
    from rich.table import Table
    from rich.text import Text

    from station.demo.reproduce.row import shown

    table = Table(box=None, pad_edge=False)
    for heading in ("row", "published in", "numbers", "state"):
        table.add_column(heading)
    for row in result.rows:
        lines, deviating = len(row.lines), row.deviating
        numbers = f"{lines - len(deviating)} of {lines}" if lines else "-"
        table.add_row(row.row.name, row.row.place, numbers, Text(str(row.state), TERMINAL_COLOURS[row.state]))
        if row.reason:
            table.add_row("", Text(row.reason, "dim"), "", "")
        for check, value in deviating:
            line = f"{check.quantity}: {check.published}; ours {shown(value)}, {check.deviation(value)}"
            table.add_row("", Text(line, "dim"), "", "")
    return table
