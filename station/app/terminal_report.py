"""The graphics that a terminal reports: sixel, kitty, or none. Asked before the first paint: imports are few."""

from __future__ import annotations

import os
import re
import select
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum

OVERRIDE = "STATION_GRAPHICS"
"""Environment variable that names the kind of graphics, whatever the terminal reports."""
REPLY_S = 0.3
"""Time for the terminal's reply, which is local or crosses a network."""
QUERIES = "\x1b[>q\x1b[16t\x1b[c"
"""Name of the terminal, size of a cell, and its attributes, to which every terminal replies."""
NAMES = ("kitty", "ghostty")
"""Terminals that draw kitty graphics in place of placeholder characters."""


class Kind(StrEnum):
    """How pictures are drawn."""

    BLOCKS = "blocks"
    SIXEL = "sixel"
    KITTY = "kitty"


@dataclass(frozen=True)
class Graphics:
    """The kind of graphics, and the width and height of a cell in pixels."""

    kind: Kind = Kind.BLOCKS
    cell: tuple[int, int] = (10, 20)


def graphics_in(reply: str, environ: Mapping[str, str]) -> Graphics:
    """The graphics that a terminal reports in its reply to `QUERIES`."""
    size = re.search(r"\x1b\[6;(\d+);(\d+)t", reply)
    cell = (int(size[2]), int(size[1])) if size and int(size[1]) and int(size[2]) else Graphics().cell
    wanted = environ.get(OVERRIDE, "")
    if wanted in list(Kind):
        return Graphics(Kind(wanted), cell)
    name = re.search(r"\x1bP>\|(\w+)", reply)
    attributes = re.search(r"\x1b\[\?([\d;]+)c", reply)
    if name and name[1].lower() in NAMES:
        return Graphics(Kind.KITTY, cell)
    sixel = attributes is not None and "4" in attributes[1].split(";")[1:]
    return Graphics(Kind.SIXEL if sixel else Kind.BLOCKS, cell)


def reported_graphics() -> Graphics:
    """The graphics of the terminal at stdin and stdout, before the application uses it."""
    reply = ""
    with suppress(ImportError, OSError, ValueError):  # no such terminal: blocks
        import termios
        import tty

        source = sys.stdin.fileno()
        before = termios.tcgetattr(source)
        try:
            tty.setcbreak(source)
            sys.stdout.write(QUERIES)
            sys.stdout.flush()
            while not re.search(r"\x1b\[\?[\d;]+c", reply) and select.select([source], [], [], REPLY_S)[0]:
                reply += os.read(source, 1024).decode("latin-1")
        finally:
            termios.tcsetattr(source, termios.TCSAFLUSH, before)
    return graphics_in(reply, os.environ)
