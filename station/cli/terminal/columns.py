"""Rows of words in columns, with control characters escaped."""

from collections.abc import Sequence

from station.common.sanitise import printable


def columns(rows: Sequence[Sequence[str]]) -> str:
    """The rows, the first being the heading, each column as wide as its widest word."""
    cells = [[printable(word) for word in row] for row in rows]
    widths = [max(len(row[i]) for row in cells) for i in range(len(cells[0]))]
    lines = ("  ".join(word.ljust(width) for word, width in zip(row, widths, strict=True)).rstrip() for row in cells)
    return "\n".join(lines)
