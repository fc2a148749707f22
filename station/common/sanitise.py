"""Words from outside (file names, EXIF, TOML) made harmless: for terminals, for files' names, for spreadsheets."""

from __future__ import annotations

import re
from pathlib import Path

LONGEST_STEM = 48
"""Letters of a photograph's name that its folder keeps."""
FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""What a spreadsheet takes for a formula when a cell begins with it."""


def encodable(text: str) -> str:
    r"""The same text, with what is no Unicode (bytes of a file's name) as `\udc80`, so that it can be written."""
    return text.encode("utf-8", "backslashreplace").decode()


def printable(text: object) -> str:
    r"""One line that a terminal only shows: line ends and control characters as `\n`, `\x1b`."""
    return "".join(
        letter if letter.isprintable() else letter.encode("unicode_escape").decode() for letter in encodable(str(text))
    )


def safe_stem(path: Path) -> str:
    """A folder's name after a photograph's: ASCII letters, digits, dots, dashes; no leading dot, never empty."""
    return re.sub(r"[^A-Za-z0-9._-]+", "_", path.stem).lstrip(".")[:LONGEST_STEM] or "_"


def cell(text: str) -> str:
    """Text that a spreadsheet shows as it is, on one line: what it would compute gets an apostrophe before it."""
    shown = printable(text)
    return f"'{shown}" if shown.startswith(FORMULA) else shown
