"""`station reproduce`: the papers' tables and figures, computed again."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import click

from station.cli.terminal.progress import progress as progress_shown
from station.common.log import log, log_json_option
from station.drawing.colours import TERMINAL_COLOURS

if TYPE_CHECKING:
    from rich.table import Table

    from station.demo.reproduce.reproduction import Reproduction

DISAGREES = 1


@click.command("reproduce")
@click.argument("name", required=False)
@click.option("--full", is_flag=True, help="Include the slow rows.")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder for page and record.")
@click.option(
    "--data",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    envvar="STATION_SHARED_DATA",
    show_envvar=True,
    help="Folder of published photographs and films; rows that require it are skipped without it.",
)
@click.option("--json", "as_json", is_flag=True, help="Write result.json to stdout instead of the table.")
@log_json_option
def reproduce(name: str | None, full: bool, out: Path, data: Path | None, as_json: bool) -> None:
    """Reproduce the papers' tables and figures: all, or the row or chapter NAME; an unknown NAME lists them.

    Returns 0 if something was computed and all of it agrees with the publications, 1 otherwise.
    """
    from station.demo.reproduce.catalogue import ROWS
    from station.demo.reproduce.row import Setting
    from station.demo.reproduce.runner import PAGE, chosen
    from station.demo.reproduce.runner import reproduce as run

    setting = Setting(data, full, os.cpu_count() or 1)
    with progress_shown(len(chosen(ROWS, name))) as progress:
        reproduction, text = run(out, ROWS, setting, name=name, progress=progress)
    if as_json:
        click.echo(text, nl=False)
    else:
        _show(reproduction)
    log("written", f"wrote {out / PAGE}", path=str(out / PAGE))
    if not reproduction.agrees:
        raise click.exceptions.Exit(DISAGREES)


def _show(reproduction: Reproduction) -> None:
    from rich.console import Console

    Console().print(_table(reproduction))
    click.echo(f"It took {reproduction.seconds:.0f} s, and {reproduction.processor_s:.0f} s of processor.")


def _table(reproduction: Reproduction) -> Table:
    """One line for each row, followed by its failed checks."""
    from rich.table import Table
    from rich.text import Text

    from station.demo.reproduce.page import shown

    table = Table(box=None, pad_edge=False)
    for heading in ("row", "published in", "numbers", "result"):
        table.add_column(heading)
    for one in reproduction.done:
        passed = sum(line.passes for line in one.lines)
        numbers = f"{passed} of {len(one.lines)}" if one.lines else "-"
        table.add_row(one.row.name, one.row.place, numbers, Text(str(one.state), TERMINAL_COLOURS[one.state]))
        if one.reason:
            table.add_row("", Text(one.reason, "dim"), "", "")
        for line in one.lines:
            if not line.passes:
                words = f"{line.check.quantity}: {line.check.published}; ours {shown(line.ours)}"
                table.add_row("", Text(words, "dim"), "", "")
    return table
