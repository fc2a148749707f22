"""The graphics that a terminal reports: sixel, kitty, or none. Asked before the first paint: imports are few."""

import math
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
NAMES = {"kitty": (0, 28), "ghostty": (0, 0)}
"""Terminals that draw kitty graphics in place of placeholder characters, from these versions on."""


class Kind(StrEnum):
    """How pictures are drawn."""

    BLOCKS = "blocks"
    SIXEL = "sixel"
    KITTY = "kitty"


@dataclass(frozen=True)
class Graphics:
    """The kind of graphics, and the width and height of a cell in pixels."""

    kind: Kind = Kind.BLOCKS
    cell: tuple[int, int] = (6, 12)
    """Small where it is not known: a picture must not cover its neighbours."""


def graphics_in(reply: str, environ: Mapping[str, str], measured: tuple[int, int] = (0, 0)) -> Graphics:
    """The graphics that a terminal reports in its reply to `QUERIES`; its window gives the `measured` cell."""
    size = re.search(r"\x1b\[6;(\d+);(\d+)t", reply)
    sizes = ((int(size[2]), int(size[1])) if size else (0, 0), measured)
    cell = next((one for one in sizes if all(one)), Graphics().cell)
    wanted = environ.get(OVERRIDE, "")
    if wanted in list(Kind):
        return Graphics(Kind(wanted), cell)
    name = re.search(r"\x1bP>\|(\w+)\W*(\d*)\.?(\d*)", reply)
    attributes = re.search(r"\x1b\[\?([\d;]+)c", reply)
    if name and (int(name[2] or 0), int(name[3] or 0)) >= NAMES.get(name[1].lower(), (math.inf, 0)):
        return Graphics(Kind.KITTY, cell)
    sixel = attributes is not None and "4" in attributes[1].split(";")[1:]
    return Graphics(Kind.SIXEL if sixel else Kind.BLOCKS, cell)


def reported_graphics() -> Graphics:
    """The graphics of the terminal at stdin and stdout, before the application uses it."""
    reply, cell = "", (0, 0)
    with suppress(ImportError, OSError, ValueError):  # no such terminal: blocks
        import fcntl
        import struct
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
        rows, columns, width, height = struct.unpack("4H", fcntl.ioctl(source, termios.TIOCGWINSZ, b"\0" * 8))
        cell = width // max(columns, 1), height // max(rows, 1)
    return graphics_in(reply, os.environ, cell)
