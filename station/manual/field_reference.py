"""Fields of result types as tables, generated from their docstrings."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Mapping

ENTRY = re.compile(r"(?P<names>\w+(?:, \w+)*) : (?P<text>\S.*)")
TYPE = re.compile(r"(\([^)]*\) )?\w+")  # the definition follows on the next lines


def fields_text(tables: Mapping[str, type]) -> str:
    """A section for each title: the attributes of a class, by name, as its docstring defines them."""
    return "\n".join("\n".join(_section(title, kind)) for title, kind in tables.items())


def _section(title: str, kind: type) -> Iterator[str]:
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
    return [(names, _sentence(" ".join(parts))) for names, parts in entries]


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:].removesuffix('.')}."
