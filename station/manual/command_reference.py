"""The reference of all commands, generated from the commands."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator

import click

SHOWN = re.compile(r"^(!\[[^\]]*\]\(picture:[^)]*\))\n+`(station [^`]*)`", re.MULTILINE)


def commands_text(program: click.Group, gallery: str = "") -> str:
    """Every command with its arguments and options, and its first picture of the gallery, as Markdown."""
    root = click.Context(program, info_name="station")
    pictures = [(one[2].split(), one[1]) for one in reversed(list(SHOWN.finditer(gallery)))]
    sections = []
    for command, context in _commands(program, root):
        path = context.command_path.split()
        shown = {" ".join(path): picture for words, picture in pictures if words[: len(path)] == path}
        sections += [*_section(command, context), *(line for picture in shown.values() for line in (picture, ""))]
    return "\n".join(sections)


def _commands(command: click.Command, context: click.Context) -> Iterator[tuple[click.Command, click.Context]]:
    if not isinstance(command, click.Group) or command.invoke_without_command:
        yield command, context
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            one = command.get_command(context, name)
            if one is not None and not one.hidden:
                yield from _commands(one, click.Context(one, info_name=name, parent=context))


def _section(command: click.Command, context: click.Context) -> Iterator[str]:
    usage = " ".join(command.collect_usage_pieces(context))
    yield f"## {context.command_path}"
    yield ""
    yield f"`{context.command_path} {usage}`"
    yield ""
    yield inspect.cleandoc(command.help or "").replace("$", "\\$").replace("\b\n", "")
    if command.epilog:
        yield from ("", f"Example: `{command.epilog.removeprefix('Example: ')}`")
    options = [param for param in command.get_params(context) if isinstance(param, click.Option)]
    records = [one for one in (option.get_help_record(context) for option in options) if one]
    if records:
        yield ""
        yield "| option | |"
        yield "|---|---|"
        yield from (f"| `{_cell(names)}` | {_cell(help_text)} |" for names, help_text in records)
    yield ""


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
