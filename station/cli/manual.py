"""`station manual`: single pages in the terminal, or all pages for a browser."""

from __future__ import annotations

import io
import shutil
import sys
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from station.cli.terminal.command import PATH, command, completed
from station.cli.terminal.progress import progress
from station.common.errors import log

if TYPE_CHECKING:
    from station.manual.pages import Page

NARROWEST, WIDEST = 40, 100
MOST_HITS = 20


def _topics(ctx: click.Context) -> list[str]:
    from station.manual.pages import read_pages

    return ["search", *(page.name for page in read_pages())]


@command("manual", log_json=False)
@click.argument("topic", metavar="[TOPIC | search WORD...]", nargs=-1, shell_complete=completed(_topics))
@click.option(
    "--html", "folder", type=PATH, metavar="DIR",
    help="Write all pages for a browser, those with Python as notebooks too.",
)  # fmt: skip
@click.option("--schemas", type=PATH, metavar="DIR", help="Write the JSON schemas of all records.")
@click.pass_context
def manual(context: click.Context, topic: tuple[str, ...], folder: Path | None, schemas: Path | None) -> None:
    """Show the manual's page TOPIC, the sections that have all WORDs, or the list of all pages."""
    if schemas is not None:
        _write_schemas(schemas)
        return
    from station.manual.pages import find_page, for_terminal, index_text, read_pages

    words = topic[1:] if topic[:1] == ("search",) else ()
    name = " ".join(topic)
    wanted = name if topic and not words and folder is None else None
    makers = {"commands": _commands, "numbers": _numbers}
    pages = read_pages({key: make(context) for key, make in makers.items() if wanted in (None, key)})
    if folder is not None:
        from station.demo.manual_pictures import PARTS, manual_pictures
        from station.manual.browser_pages import write_manual

        log("pictures", "drawing the pictures: the procedures measure what simulated cameras photograph")
        with progress(len(PARTS)) as shown:
            pictures = manual_pictures(partial(_printed, context.find_root().command), shown)
        click.echo(write_manual(pages, folder, pictures))
    elif words:
        click.echo_via_pager(_formatted(_hits(pages, words)))
    else:
        text = find_page(pages, name).text if topic else index_text(pages)
        click.echo_via_pager(_formatted(for_terminal(text)))


def _printed(program: click.Command, words: Sequence[str]) -> str:
    """The text that a command writes to stdout; what it logs is not shown."""
    out = io.StringIO()
    with redirect_stdout(out), redirect_stderr(io.StringIO()), suppress(SystemExit):
        program.main(list(words), prog_name="station")
    return out.getvalue()


def _hits(pages: Sequence[Page], words: Sequence[str]) -> str:
    """The sections that have all words, as Markdown. Raises BadParameter if there are none."""
    from procedures.outcome import BadParameter
    from station.manual.pages import PAGE_LINK, search

    hits = search(pages, words)
    if not hits:
        raise BadParameter(f"no section of the manual has all of: {' '.join(words)}", "give fewer or other words")
    lines = [
        f"- **{section.page.title}**{f', {section.heading}' if section.heading else ''} "
        f"(`station manual {section.page.name}`)  \n  {PAGE_LINK.sub(lambda match: match[1], line).strip()}"
        for section, line in hits[:MOST_HITS]
    ]
    rest = [f"\nand {len(hits) - MOST_HITS} more: add a word"] if len(hits) > MOST_HITS else []
    return "\n".join([*lines, *rest])


def _write_schemas(folder: Path) -> None:
    import json

    from station.batch.run import batch_schema
    from station.common.durable_files import write_whole
    from station.procedure.schema import procedure_named, procedure_names, schema_of

    folder.mkdir(parents=True, exist_ok=True)
    schemas = {name: schema_of(procedure_named(name)) for name in procedure_names()}
    for name, schema in {**schemas, "batch": batch_schema()}.items():
        path = folder / f"{name}.schema.json"
        write_whole(path, json.dumps(schema, indent=1).encode())
        click.echo(path)


def _commands(context: click.Context) -> str:
    from station.manual.command_reference import commands_text
    from station.manual.pages import find_page, read_pages

    program = context.find_root().command
    assert isinstance(program, click.Group)
    return commands_text(program, find_page(read_pages(), "gallery").text)


def _numbers(context: click.Context) -> str:
    from procedures.numbers import reference_text
    from procedures.pattern_psf.diagnostics import Diagnostics
    from procedures.two_photo.diagnostics import PairDiagnostics
    from procedures.two_photo.pair_consistency import NearSpectrum, PairConsistency
    from station.manual.command_reference import fields_text

    tables = {"Diagnostics of the chart": Diagnostics, "Diagnostics of two photographs": PairDiagnostics}
    diagnostics = fields_text(
        {**tables, "Consistency of two photographs": PairConsistency, "Spectrum of the near photograph": NearSpectrum}
    )
    return f"{reference_text()}\n{diagnostics}"


def _formatted(markdown: str) -> str:
    from rich.console import Console
    from rich.markdown import Markdown

    page = io.StringIO()
    width = min(max(shutil.get_terminal_size().columns, NARROWEST), WIDEST)
    Console(file=page, width=width, force_terminal=sys.stdout.isatty()).print(Markdown(markdown, hyperlinks=False))
    return page.getvalue()
