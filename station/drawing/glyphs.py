"""Which characters a terminal can be trusted with, and how strings from outside are shown as what they are."""

from __future__ import annotations

import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass

LIMITED_TERMINALS = ("dumb", "vt", "linux", "ansi", "xterm-mono")
"""Beginnings of TERM whose fonts lack more than ASCII and a few lines."""
HIDDEN = ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")
"""Unicode categories that steer a terminal, turn writing round, or show nothing."""


@dataclass(frozen=True)
class Glyphs:
    """The marks of states and bars; each stands beside a word or a shape, so that colour is never needed."""

    ascii: bool
    done: str
    now: str
    todo: str
    good: str
    bad: str
    full: str
    empty: str
    plus_minus: str

    def spelt(self, text: str) -> str:
        """A number with its signs, in characters that the terminal has."""
        return text.replace("±", self.plus_minus).replace("°", " deg") if self.ascii else text


UNICODE = Glyphs(False, done="✓", now="▶", todo="·", good="✓", bad="✗", full="█", empty="░", plus_minus="±")
ASCII = Glyphs(True, done="x", now=">", todo=".", good="ok", bad="!!", full="#", empty="-", plus_minus="+-")


def glyphs_for(environ: Mapping[str, str], encoding: str) -> Glyphs:
    """ASCII where colour is unwanted (NO_COLOR), the terminal is limited, or its encoding is not Unicode."""
    limited = environ.get("TERM", "").startswith(LIMITED_TERMINALS)
    unicode = encoding.lower().replace("-", "").startswith("utf")
    return ASCII if "NO_COLOR" in environ or limited or not unicode else UNICODE


def visible(text: str) -> str:
    """The same text on one line, with every character that is not seen as itself written as its escape: \\x1b, \\n."""
    return "".join(_escaped(c) if unicodedata.category(c) in HIDDEN else c for c in text)


def _escaped(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")
