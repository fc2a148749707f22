"""The reference of all commands and of the fields of results, generated from the program."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Mapping

import click

ENTRY = re.compile(r"(?P<names>\w+(?:, \w+)*) : (?P<text>\S.*)")
TYPE = re.compile(r"(\([^)]*\) )?\w+")  # the definition follows on the next lines


def fields_text(tables: Mapping[str, type]) -> str:
    """A section for each title: the attributes of a class, by name, as its docstring defines them."""
    return "\n".join("\n".join(_field_table(title, kind)) for title, kind in tables.items())


def _field_table(title: str, kind: type) -> Iterator[str]:
    yield from (f"## {title}", "", "| name | definition |", "|---|---|")
    for names, definition in attributes(kind):
        shown = ", ".join(f"`{name}`" for name in names)
        yield f"| {shown} | {definition.replace('|', chr(92) + '|')} |"
    yield ""


def attributes(kind: type) -> list[tuple[list[str], str]]:
    """Names and definition of every entry in a docstring's section of attributes, on its line or below its type."""
    lines = inspect.getdoc(kind) or ""
    _, _, section = lines.partition("Attributes\n----------\n")
    entries: list[tuple[list[str], list[str]]] = []
    for line in section.splitlines():
        entry = ENTRY.match(line)
        if entry:
            entries.append((entry["names"].split(", "), [] if TYPE.fullmatch(entry["text"]) else [entry["text"]]))
        elif entries and line.strip():
            entries[-1][1].append(line.strip())
    texts = [(names, " ".join(parts)) for names, parts in entries]
    return [(names, f"{text[:1].upper()}{text[1:].removesuffix('.')}.") for names, text in texts]


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
    """The command and all its subcommands, in the order of the help."""
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
