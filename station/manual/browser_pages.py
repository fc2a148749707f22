"""The manual as self-contained HTML pages in the style of the reports."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from markdown_it import MarkdownIt
from markdown_it.renderer import RendererProtocol
from markdown_it.token import Token
from markdown_it.utils import EnvType, OptionsDict
from markupsafe import Markup

from procedures.outcome import BadParameter
from station.common.durable_files import write_whole
from station.manual.pages import PARTS, PICTURE, Page, add_formulas, index_text, sections_of
from station.reports.page import html, render

BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def cells_of(text: str) -> list[dict[str, Any]]:
    """A page's cells: text and code in turn, as nbformat 4.4 has them."""
    texts = BLOCK.split(PICTURE.sub("", text))
    parts = ((("code" if n % 2 else "markdown"), part.strip()) for n, part in enumerate(texts))
    code: dict[str, Any] = {"execution_count": None, "outputs": []}
    return [
        {"cell_type": kind, "metadata": {}, "source": part, **(code if kind == "code" else {})}
        for kind, part in parts
        if part
    ]


def notebook_of(page: Page) -> str | None:
    """The page as a notebook; None without Python in it."""
    cells = cells_of(page.text)
    if not any(cell["cell_type"] == "code" for cell in cells):
        return None
    python = {"name": "python3", "display_name": "Python 3", "language": "python"}
    return json.dumps(
        {"nbformat": 4, "nbformat_minor": 4, "metadata": {"kernelspec": python}, "cells": cells}, indent=1
    )


INDEX = "index"
SEARCH = "search.js"


def write_manual(pages: Sequence[Page], folder: Path, pictures: Mapping[str, bytes]) -> Path:
    """Write all pages, those with Python as notebooks too, pictures and index into a folder; returns the index. Raises
    BadParameter if it cannot be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadParameter(f"{folder} cannot be made: {error.strerror}", "name another folder with --html") from error
    for page in pages:
        write_whole(folder / f"{page.name}.html", _html(page, pages).encode())
        notebook = notebook_of(page)
        if notebook is not None:
            write_whole(folder / f"{page.name}.ipynb", notebook.encode())
    for name, data in pictures.items():
        write_whole(folder / name, data)
    entries = []
    for section in (one for page in pages for one in sections_of(page)):
        place = f"#{section_name(section.heading)}" if section.heading else ""
        text = " ".join(re.sub(r"\]\([^)]*\)|[*`|\[]|^-+$", " ", section.text, flags=re.MULTILINE).split())
        entries.append([f"{section.page.name}.html{place}", section.page.title, section.heading, text])
    write_whole(folder / SEARCH, f"const SECTIONS = {json.dumps(entries, ensure_ascii=False)};\n".encode())
    index = folder / f"{INDEX}.html"
    write_whole(index, _html(Page("", INDEX, index_text(pages)), pages).encode())
    return index


def _html(page: Page, pages: Sequence[Page]) -> str:
    menu = [(called, [one for one in pages if one.part == part]) for part, called in PARTS.items()]
    contents = [(section_name(one.heading), one.heading) for one in sections_of(page) if one.heading]
    return render(
        "manual.html", title=page.title, body=Markup(html_of(page.text)), menu=menu, here=page.name,
        contents=contents if len(contents) > 1 else [],
    )  # fmt: skip


def html_of(markdown: str) -> str:
    """The body of a page, with links to the other HTML pages and ids of headings."""
    reader = MarkdownIt("commonmark", {"html": False}).enable("table")
    add_formulas(reader)
    tokens = reader.parse(markdown)
    for token, following in zip(tokens, [*tokens[1:], None], strict=True):
        if token.type == "heading_open" and following is not None:
            token.attrSet("id", section_name(following.content))
        for child in token.children or ():
            href = str(child.attrGet("href") or "")
            page, mark, section = href.partition("#")
            if child.type == "link_open" and page.endswith(".md"):
                child.attrSet("href", f"{Path(page).stem}.html{mark}{section}")
    reader.add_render_rule("image", _picture)
    return str(reader.renderer.render(tokens, reader.options, {}))


def _picture(renderer: RendererProtocol, tokens: Sequence[Token], at: int, options: OptionsDict, env: EnvType) -> str:
    source, caption = str(tokens[at].attrGet("src")).removeprefix("picture:"), tokens[at].content
    return html('<span class="picture"><img src="{}" alt="">{}</span>', source, caption)


def section_name(heading: str) -> str:
    """Id of a heading: its words in lower case with hyphens."""
    return re.sub(r"[^\w-]", "", heading.lower().replace(" ", "-"))
