"""Characters for states and bars, by the capabilities of the terminal."""

from collections.abc import Mapping
from dataclasses import dataclass

LIMITED_TERMINALS = ("dumb", "vt", "linux", "ansi", "xterm-mono")
"""Beginnings of TERM with fonts that lack more than ASCII and a few lines."""


@dataclass(frozen=True)
class Glyphs:
    """Marks of states and bars; each accompanies a word or a shape, so that colour is never required."""

    ascii: bool
    done: str
    now: str
    todo: str
    good: str
    bad: str
    full: str
    empty: str
    plus_minus: str
    space: str
    """Between a mark and its line; no-break where the terminal has one, so that they are not separated."""

    def spelt(self, text: str) -> str:
        """A number with its signs, in characters of the terminal."""
        return text.translate(SPELT) if self.ascii else text


SPELT = str.maketrans({"±": "+-", "°": " deg", "→": ">", "←": "<", "↓": "v", "↑": "^"})
UNICODE = Glyphs(
    False, done="✓", now="▶", todo="·", good="✓", bad="✗", full="█", empty="░", plus_minus="±",
    space="\N{NO-BREAK SPACE}",
)  # fmt: skip
ASCII = Glyphs(
    True, done="x", now=">", todo=".", good="ok", bad="!!", full="#", empty="-", plus_minus="+-",
    space=" ",
)  # fmt: skip


def glyphs_for(environ: Mapping[str, str], encoding: str) -> Glyphs:
    """ASCII where colour is unwanted (NO_COLOR), the terminal is limited, or its encoding is not Unicode."""
    limited = environ.get("TERM", "").startswith(LIMITED_TERMINALS)
    unicode = encoding.lower().replace("-", "").startswith("utf")
    return ASCII if "NO_COLOR" in environ or limited or not unicode else UNICODE


GLYPHS = {
    "0": "### #.# #.# #.# ###", "1": ".#. ##. .#. .#. ###", "2": "### ..# ### #.. ###", "3": "### ..# ### ..# ###",
    "4": "#.# #.# ### ..# ..#", "5": "### #.. ### ..# ###", "6": "### #.. ### #.# ###", "7": "### ..# ..# ..# ..#",
    "8": "### #.# ### #.# ###", "9": "### #.# ### ..# ###", ".": ". . . . #", "-": "... ... ### ... ...",
    ">": "#.. .#. ..# .#. #..", "<": "..# .#. #.. .#. ..#", "=": "... ### ... ### ...", "?": "### ..# .## ... .#.",
    "^": ".#. #.# ... ... ...", "v": "... ... ... #.# .#.", " ": ". . . . .",
}  # fmt: skip
ROWS = 5
ACROSS = 2
"""Characters per point, which are about twice as high as wide."""


def big_lines(text: str, width: int, height: int, ink: str) -> list[str]:
    """The text in letters of `ink`, as large as fits `width` x `height`, else unchanged. Raises KeyError without a
    glyph."""
    rows = [" ".join(GLYPHS[letter].split()[row] for letter in text) for row in range(ROWS)]
    points = len(rows[0])
    scale = min(width // (ACROSS * points), height // ROWS) if points else 0
    if scale < 1:
        return [text[:width]]
    wide = ACROSS * scale
    lines = ["".join((ink if point == "#" else " ") * wide for point in row).rstrip() for row in rows]
    return [line for line in lines for _ in range(scale)]
