"""Pages with Python as Jupyter notebooks: their text as Markdown cells, their blocks as code cells."""

from __future__ import annotations

import json
import re
from typing import Any

from station.manual.pages import PICTURE, Page

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
