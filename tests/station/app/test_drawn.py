"""Images and curves in characters, compared with their data."""

import asyncio
import unicodedata

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from textual.app import App, ComposeResult

from drivers.interfaces import Condition
from procedures.raw import Plane
from station.app.bars import DeviceBar, packed
from station.app.screens.dialogs import paragraphs_of
from station.app.terminal_images import Thumbnail, in_letters, lay_out, shrink, thumbnail
from station.app.widgets import left_of, literal, progress_in_words
from station.bench.stage_watch import DeviceState
from station.common.sanitise import printable
from station.drawing.glyphs import ASCII, UNICODE, glyphs_for
from station.drawing.terminal_plots import GUTTER, TerminalCurve, TerminalFrame, plot
from station.guide.frontend import ProgressEvent

SIDES = st.integers(1, 40)


@given(SIDES, SIDES, SIDES, SIDES)
def test_shrinking_keeps_a_flat_picture_flat_and_every_value_between_its_ends(rows, columns, to_rows, to_columns):
    rng = np.random.default_rng(rows * 41 + columns)
    picture = rng.uniform(0, 1, (rows, columns))
    small = shrink(picture, to_rows, to_columns)
    assert small.shape == (to_rows, to_columns)
    # rounding of the running sums that the means are differences of
    assert picture.min() - 1e-9 <= small.min() <= small.max() <= picture.max() + 1e-9


def test_shrinking_by_whole_blocks_keeps_the_mean(rng):
    picture = rng.uniform(0, 1, (24, 36))
    assert shrink(picture, 6, 9).mean() == pytest.approx(picture.mean(), abs=1e-12)


@given(SIDES, SIDES, st.integers(1, 100), st.integers(1, 50))
def test_a_layout_fits_its_room(rows, columns, width, height):
    cells = lay_out(Thumbnail(np.zeros((rows, columns), np.uint8)), width, height)
    assert cells.levels.shape[1] <= max(width, 1)
    assert len(cells.levels) // 2 <= max(height, 1)


def test_marks_lie_where_they_are_in_the_plane_and_help_breaks_where_the_terminal_does():
    samples = np.zeros((400, 600), np.float32)
    samples[200:, 300:] = 1.0
    cells = lay_out(thumbnail(Plane("G1", samples, 1e-3), [(300.0, 200.0)]), 60, 20)
    assert cells.marked == {(10, 30)}
    letters = in_letters(cells)
    assert letters[10][30] == "X"
    assert letters[15][45] == "@"
    assert letters[5][45] == " "
    page = "# Words\n\n**s/t**: how many\nsamples (`station\nmanual x`).\n\n```\n o   o\n`-' o\n```\nAfter\nit.\n"
    assert paragraphs_of(page) == [
        "# Words", "", "s/t: how many samples (station manual x).", "", " o   o", "`-' o", "After it."
    ]  # fmt: skip
    plane = Plane("G1", np.ones((40, 60), np.float32), 1e-3)
    assert not lay_out(thumbnail(plane, [(-5.0, 3.0), (70.0, 3.0)]), 30, 10).marked


def heights(lines: list[str]) -> list[int]:
    """The uppermost dot of each column of characters, in rows of characters from the top."""
    body = [line[GUTTER:] for line in lines[:-1]]
    width = max(len(line) for line in body)
    return [next((i for i, line in enumerate(body) if line[c : c + 1].strip()), -1) for c in range(width)]


@pytest.mark.parametrize("ascii", [True, False])
def test_a_falling_line_falls(ascii):
    x = np.linspace(0, 1, 50)
    shown = heights(plot([TerminalCurve(x, 1 - x)], TerminalFrame((0, 1), (0, 1)), 45, 21, ascii=ascii))
    assert shown == sorted(shown)
    assert shown[0] == 0
    assert shown[-1] == 19


def test_curves_and_bands_are_distinguished_without_colour():
    x = np.linspace(0, 1, 50)
    lines = plot([TerminalCurve(x, 0 * x + 0.5, band=0 * x + 0.25)], TerminalFrame((0, 1), (0, 1)), 45, 22, ascii=True)
    column = "".join(line[GUTTER + 4] for line in lines[:-1])
    assert column.count("*") == 1
    assert column.index(".") < column.index("*") < column.rindex(".")
    one, other = TerminalCurve(x, 0 * x + 0.2), TerminalCurve(x, 0 * x + 0.8, dashed=True)
    lines = plot([one, other], TerminalFrame((0, 1), (0, 1)), 45, 12)
    rows = [line[GUTTER:] for line in lines[:-1] if line[GUTTER:].strip()]
    assert " " in rows[0].strip()
    assert " " not in rows[-1].strip()


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=1, max_size=8))
def test_any_numbers_can_be_drawn(values):
    x = np.arange(len(values), dtype=float)
    lines = plot([TerminalCurve(x, np.array(values))], TerminalFrame((0.0, 8.0), (0.0, 1.0)), 30, 8)
    assert len(lines) == 8


@given(st.text(max_size=40))
def test_no_character_steers_the_terminal(text):
    # Python calls spaces other than the usual one unprintable; they steer nothing
    assert all(c.isprintable() or unicodedata.category(c) == "Zs" for c in printable(text))


@pytest.mark.parametrize(
    ("environ", "encoding", "glyphs"),
    [
        ({"TERM": "xterm-256color"}, "utf-8", UNICODE),
        ({"TERM": "screen-256color", "NO_COLOR": "1"}, "utf-8", ASCII),
        ({"TERM": "linux"}, "utf-8", ASCII),
        ({"TERM": "vt220"}, "UTF-8", ASCII),
        ({"TERM": "xterm"}, "ISO-8859-1", ASCII),
    ],
)
def test_limited_terminals_get_plain_letters(environ, encoding, glyphs):
    assert glyphs_for(environ, encoding) is glyphs


def test_the_time_left_and_the_devices_line_fit():
    began, now = ProgressEvent("estimating", 0, 8), ProgressEvent("estimating", 2, 8)
    assert left_of(began, began, 0.0) is None
    assert left_of(began, now, 10.0) == pytest.approx(30.0)
    assert "about 25 s left" in progress_in_words(now, 5.0, 30.0, UNICODE)
    assert "2 of 8" in progress_in_words(now, 5.0, None, UNICODE)
    assert "about 1 min 10 s left" in progress_in_words(ProgressEvent("homing", left_s=75.0), 5.0, 75.0, UNICODE)
    parts = [literal(word) for word in ("F12 STOP ALL", "stage: homing", "imu: ready", "a name that is much too long")]
    assert packed(parts, 28).plain == "F12 STOP ALL  stage: homing\nimu: ready\na name that is much too long"


def test_devices_shown_before_the_width_is_known_get_their_lines():
    class Bare(App[None]):
        glyphs = UNICODE

        def compose(self) -> ComposeResult:
            yield DeviceBar()

    async def use() -> None:
        app = Bare()
        bar = DeviceBar()
        homing = DeviceState("stage", Condition("homing the rows, then the columns", True), moving=True)
        async with app.run_test(size=(80, 24)):
            bar.show([homing], "")
            assert [bar.get_content_height(app.size, app.size, width) for width in (80, 40)] == [1, 2]

    asyncio.run(use())
