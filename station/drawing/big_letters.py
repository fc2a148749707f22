"""Numbers legible from a distance, in letters of 3 x 5 points."""

from __future__ import annotations

GLYPHS = {
    "0": "### #.# #.# #.# ###", "1": ".#. ##. .#. .#. ###", "2": "### ..# ### #.. ###", "3": "### ..# ### ..# ###",
    "4": "#.# #.# ### ..# ..#", "5": "### #.. ### ..# ###", "6": "### #.. ### #.# ###", "7": "### ..# ..# ..# ..#",
    "8": "### #.# ### #.# ###", "9": "### #.# ### ..# ###", ".": ". . . . #", "-": "... ... ### ... ...",
    ">": "#.. .#. ..# .#. #..", "<": "..# .#. #.. .#. ..#", "=": "... ### ... ### ...", "?": "### ..# .## ... .#.",
    " ": ". . . . .",
}  # fmt: skip
ROWS = 5
ACROSS = 2
"""Characters per point, which are about twice as high as wide."""


def big_lines(text: str, width: int, height: int, ink: str) -> list[str]:
    """The text in letters drawn with `ink`, as large as fits into `width` x `height` characters; else unchanged.

    Raises KeyError for characters without a glyph.
    """
    rows = [" ".join(GLYPHS[letter].split()[row] for letter in text) for row in range(ROWS)]
    points = len(rows[0])
    scale = min(width // (ACROSS * points), height // ROWS) if points else 0
    if scale < 1:
        return [text[:width]]
    wide = ACROSS * scale
    lines = ["".join((ink if point == "#" else " ") * wide for point in row).rstrip() for row in rows]
    return [line for line in lines for _ in range(scale)]
