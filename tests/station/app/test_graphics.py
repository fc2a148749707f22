"""Pictures in a terminal's own graphics: what it reports, and what a decoder by the specification sees of them."""

import base64
import re
import zlib

import numpy as np
import pytest
from rich.cells import cell_len

from procedures.plan import Outline
from station.app.terminal_graphics import GREYS, fitted, indexed, kitty, palette, placeholders, sixel
from station.app.terminal_images import PRESENT, WANTED, Thumbnail
from station.app.terminal_report import Graphics, Kind, graphics_in

PICTURE = Thumbnail(
    np.tile(np.linspace(0, 255, 60, dtype=np.uint8), (40, 1)),
    outline=Outline(((0.2, 0.2), (0.4, 0.2), (0.4, 0.5), (0.2, 0.5)), ((0.6, 0.3), (0.9, 0.3), (0.9, 0.8), (0.6, 0.8))),
)
XTERM, KITTY = "\x1bP>|XTerm(388)\x1b\\\x1b[6;18;9t", "\x1bP>|kitty(0.35.1)\x1b\\\x1b[6;30;15t\x1b[?62;c"


@pytest.mark.parametrize(
    ("reply", "environ", "found"),
    [
        (f"{XTERM}\x1b[?64;1;2;4;6c", {}, Graphics(Kind.SIXEL, (9, 18))),
        (f"{XTERM}\x1b[?64;1;2;6c", {}, Graphics(Kind.BLOCKS, (9, 18))),
        ("\x1b[?4;6c", {}, Graphics()),  # the first number is the class of the terminal: a VT132, without sixel
        (KITTY, {}, Graphics(Kind.KITTY, (15, 30))),
        (KITTY.replace("35.1", "26.5"), {}, Graphics(Kind.BLOCKS, (15, 30))),  # without placeholders
        ("\x1bP>|ghostty 1.2.0\x1b\\\x1b[?62;4c", {}, Graphics(Kind.KITTY)),
        (KITTY, {"STATION_GRAPHICS": "blocks"}, Graphics(Kind.BLOCKS, (15, 30))),
        ("", {}, Graphics()),
    ],
)
def test_a_terminal_reports_its_graphics(reply, environ, found):
    assert graphics_in(reply, environ) == found


def decoded(data: str) -> np.ndarray:
    """A decoder of sixels by DEC STD 070: indices, -1 where nothing was drawn."""
    size = re.match(r'\x1bP0;1q"1;1;(\d+);(\d+)', data)
    picture = np.full((int(size[2]), int(size[1])), -1)
    x = y = colour = 0
    for token in re.finditer(r"#(\d+)(;2;\d+;\d+;\d+)?|!(\d+)([?-~])|([?-~])|([$-])", data[size.end() : -2]):
        if token[1]:
            colour = int(token[1])
        elif token[6]:
            x, y = 0, y + 6 * (token[6] == "-")
        else:
            n, bits = int(token[3] or 1), ord(token[4] or token[5]) - 63
            for row in range(6):
                if bits >> row & 1:
                    picture[y + row, x : x + n] = colour
            x += n
    return picture


def test_sixels_are_the_picture():
    indices = indexed(PICTURE, 120, 77)  # the last band is not full
    np.testing.assert_array_equal(decoded(sixel(indices)), indices)
    assert {GREYS - 1 + PRESENT, GREYS - 1 + WANTED} <= set(np.unique(indices))
    arrow = indices[:, 50:70] == GREYS - 1 + PRESENT  # between the outlines
    assert arrow.any(), "an arrow leads to the wanted place"


def test_kitty_gets_the_picture_in_chunks_and_places_it_at_text():
    noise = np.random.default_rng(1).integers(0, 256, (40, 60)).astype(np.uint8)
    indices = indexed(Thumbnail(noise), 300, 200)
    parts = re.findall(r"\x1b_G([^;]*);([^\x1b]*)\x1b\\", kitty(indices, 7, 30, 10))
    assert len(parts) > 1
    assert max(len(data) for _, data in parts) <= 4096
    assert [keys[-3:] for keys, _ in parts] == ["m=1"] * (len(parts) - 1) + ["m=0"]
    pixels = np.frombuffer(zlib.decompress(base64.b64decode("".join(data for _, data in parts))), np.uint8)
    np.testing.assert_array_equal(pixels.reshape(200, 300, 3), palette()[indices])
    lines = placeholders(30, 10)
    assert [cell_len(line) for line in lines] == [30] * 10
    assert lines[0].startswith("\U0010eeee\u0305\u0305\U0010eeee\u0305\U0010eeee")
    # the marks of the first rows, as in the protocol's table
    assert [line[1] for line in lines] == list("\u0305\u030d\u030e\u0310\u0312\u033d\u033e\u033f\u0346\u034a")


def test_a_picture_keeps_its_proportions_on_cells_of_any_shape():
    assert fitted(PICTURE, 80, 40, (10, 20)) == (64, 21), "at most MAX_PX wide"
    assert fitted(PICTURE, 30, 40, (10, 20)) == (30, 10)
