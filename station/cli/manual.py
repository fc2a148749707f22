"""`station manual`: single pages in the terminal, or all pages for a browser."""

from __future__ import annotations

import io
import shutil
import sys
from pathlib import Path

import click

from station.cli.terminal.command import StationCommand

NARROWEST, WIDEST = 40, 100
"""Limits of the width of a page, in columns."""


@click.command("manual", cls=StationCommand)
@click.argument("topic", required=False)
@click.option(
    "--html",
    "folder",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Write all pages for a browser, those with Python as notebooks too.",
)
@click.option(
    "--schemas", type=click.Path(path_type=Path), metavar="DIR", help="Write the JSON schemas of all records."
)
@click.pass_context
def manual(context: click.Context, topic: str | None, folder: Path | None, schemas: Path | None) -> None:
    """Show the manual's page TOPIC, or the list of all pages."""
    if schemas is not None:
        _write_schemas(schemas)
        return
    from station.manual.pages import find_page, for_terminal, index_text, read_pages

    pages = read_pages(_generated(context, topic if folder is None else None))
    text = find_page(pages, topic).text if topic else index_text(pages)
    if folder is None:
        click.echo_via_pager(_formatted(for_terminal(text)))
        return
    from station.manual.browser_pages import write_manual

    click.echo(write_manual(pages, folder))


def _write_schemas(folder: Path) -> None:
    """Write NAME.schema.json for each procedure."""
    import json

    from station.common.atomic_files import write_whole
    from station.procedure.registry import procedure_named, procedure_names
    from station.procedure.schema import schema_of

    folder.mkdir(parents=True, exist_ok=True)
    for name in procedure_names():
        path = folder / f"{name}.schema.json"
        write_whole(path, json.dumps(schema_of(procedure_named(name)), indent=1).encode())
        click.echo(path)


def _generated(context: click.Context, topic: str | None) -> dict[str, str]:
    """Generated parts of pages: all of them, or those of one topic."""
    makers = {"commands": _commands, "numbers": _numbers}
    return {name: make(context) for name, make in makers.items() if topic in (None, name)}


def _commands(context: click.Context) -> str:
    from station.manual.command_reference import commands_text

    program = context.find_root().command
    assert isinstance(program, click.Group)
    return commands_text(program)


def _numbers(context: click.Context) -> str:
    """All numbers, and the diagnostics behind verdicts."""
    from procedures.numbers import reference_text
    from procedures.pattern_psf.diagnostics import Diagnostics
    from procedures.two_photo.diagnostics import PairDiagnostics
    from procedures.two_photo.pair_consistency import NearSpectrum, PairConsistency
    from station.manual.field_reference import fields_text

    tables = {"Diagnostics of the chart": Diagnostics, "Diagnostics of two photographs": PairDiagnostics}
    diagnostics = fields_text(
        {**tables, "Consistency of two photographs": PairConsistency, "Spectrum of the near photograph": NearSpectrum}
    )
    return f"{reference_text()}\n{diagnostics}"


def _formatted(markdown: str) -> str:
    """The page as text, coloured on a terminal."""
    from rich.console import Console
    from rich.markdown import Markdown

    page = io.StringIO()
    width = min(max(shutil.get_terminal_size().columns, NARROWEST), WIDEST)
    Console(file=page, width=width, force_terminal=sys.stdout.isatty()).print(Markdown(markdown, hyperlinks=False))
    return page.getvalue()
