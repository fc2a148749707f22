"""Widgets of the screens: images in half blocks, curves, the list of steps, live numbers, progress. Every text from
outside passes `literal`, which shows markup, escape sequences and control characters as text."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, cast

from rich.segment import Segment
from rich.style import Style
from textual.content import Content
from textual.strip import Strip
from textual.visual import VisualType
from textual.widget import Widget
from textual.widgets import Static

from station.app.terminal_report import Graphics, Kind
from station.common.sanitise import printable
from station.drawing.colours import MARK_GROUND, MARK_TEXT, PRESENT_LINE, WANTED_LINE
from station.drawing.glyphs import Glyphs, big_lines
from station.results.comparison import measurement_words

if TYPE_CHECKING:
    from textual.geometry import Region

    from procedures.plan import Plan, Reading
    from station.app.terminal_images import Cells, Thumbnail
    from station.guide.frontend import ProgressEvent

GREYS = 32
"""Grey levels in half blocks; runs of one level are one segment."""
PLAIN = Style()  # Textual's filter for NO_COLOR requires a style on every segment
MARK = Style(color=MARK_TEXT, bgcolor=MARK_GROUND, bold=True)
BAR = 16


def literal(text: str, style: str = "") -> Content:
    """Text without markup, on one line, in a style."""
    return Content.styled(printable(text), style) if style else Content(printable(text))


def lines_of(*lines: object) -> Content:
    """Lines one below the other."""
    return Content("\n").join(line if isinstance(line, Content) else literal(str(line)) for line in lines)


class Part(Static):
    """A text widget with the terminal's glyphs, without focus and markup."""

    def __init__(self, text: str = "", **options: str) -> None:
        super().__init__(literal(text), markup=False, **options)  # type: ignore[arg-type]

    @property
    def glyphs(self) -> Glyphs:
        return cast(Glyphs, self.app.glyphs)  # type: ignore[attr-defined]

    def update(self, content: VisualType = "", *, layout: bool = True) -> None:
        """Show a text; an unchanged text causes neither layout nor painting."""
        shown = self.content
        if not (isinstance(shown, Content) and isinstance(content, Content) and shown.is_same(content)):
            super().update(content, layout=layout)

    def say(self, text: str, style: str = "") -> None:
        """Show a sentence, or hide the widget if it is empty."""
        self.update(literal(text, style))
        self.display = bool(text)


INK = (*(f"rgb({v},{v},{v})" for v in (round(i * 255 / (GREYS - 1)) for i in range(GREYS))), PRESENT_LINE, WANTED_LINE)
"""Colours of a half block: greys, then the lines of the outlines."""


@lru_cache(maxsize=len(INK) ** 2)
def _half_block(upper: int, lower: int) -> Style:
    return Style.parse(f"{INK[upper]} on {INK[lower]}")


class Drawn(Widget):
    """A widget whose lines are redrawn when its contents or its size change."""

    _strips: tuple[Strip, ...] = ()

    @property
    def glyphs(self) -> Glyphs:
        return cast(Glyphs, self.app.glyphs)  # type: ignore[attr-defined]

    def redraw(self) -> None:
        self._strips = self.draw(self.size.width, self.size.height) if self.size.area else ()
        self.refresh()

    def draw(self, width: int, height: int) -> tuple[Strip, ...]:
        raise NotImplementedError

    def on_resize(self) -> None:
        self.redraw()

    def render_line(self, y: int) -> Strip:
        strip = self._strips[y] if y < len(self._strips) else _text_strip("")
        ground = self.rich_style
        return strip.adjust_cell_length(self.size.width, ground).apply_style(
            Style(color=ground.color, bgcolor=ground.bgcolor)
        )


class Picture(Drawn):
    """A thumbnail, two pixels per cell, with marks as crosses and a caption; `words` without a thumbnail."""

    def __init__(self, words: str = "", **options: str) -> None:
        super().__init__(**options)  # type: ignore[arg-type]
        self.words = words
        self.picture: Thumbnail | None = None
        self._sixels = ""

    def show(self, picture: Thumbnail | None) -> None:
        self.picture = picture
        self.redraw()

    def show_words(self, words: str) -> None:
        """Show a drawing in characters, or a sentence, instead of an image."""
        self.words = words
        self.show(None)

    def draw(self, width: int, height: int) -> tuple[Strip, ...]:
        self._sixels = ""
        if self.picture is None:
            return tuple(_text_strip(line) for line in centred(self.words, width, height))
        from station.app.terminal_images import LEGEND, in_letters, lay_out

        words = self.picture.caption if self.picture.outline is None else LEGEND[self.glyphs.ascii]
        terminal: Graphics = self.app.graphics  # type: ignore[attr-defined]
        if terminal.kind is not Kind.BLOCKS:
            return (*self._in_pixels(terminal, width, max(1, height - 1)), _text_strip(printable(words)))

        cells = lay_out(self.picture, width, max(1, height - 1))
        rows = [_text_strip(line) for line in in_letters(cells)] if self.glyphs.ascii else _half_blocks(cells)
        return (*rows, _text_strip(printable(words)))

    def _in_pixels(self, terminal: Graphics, width: int, height: int) -> list[Strip]:
        """The lines of a picture in the terminal's graphics: placeholders, or blanks over which sixels are drawn."""
        from station.app import terminal_graphics as graphics

        assert self.picture is not None
        cell = terminal.cell
        columns, rows = graphics.fitted(self.picture, width, min(height, len(graphics.ROW_MARKS)), cell)
        indices = graphics.indexed(self.picture, columns * cell[0], rows * cell[1])
        if terminal.kind is Kind.KITTY:
            number = 1 + id(self) // 16 % 0xFFFF
            self._write(graphics.kitty(indices, number, columns, rows))
            ink = Style(color=f"rgb(0,{number >> 8},{number & 255})")
            return [Strip([Segment(line, ink)], columns) for line in graphics.placeholders(columns, rows)]
        self._sixels = graphics.sixel(indices)
        return [_text_strip(" " * columns) for _ in range(rows)]

    def render_lines(self, crop: Region) -> list[Strip]:
        """Its lines; sixels are drawn after the blanks below them."""
        if self._sixels:
            self.call_after_refresh(self._draw_sixels)
        return super().render_lines(crop)

    def _draw_sixels(self) -> None:
        from station.app.terminal_graphics import at_cell

        if self._sixels and self.picture is not None and self.screen.is_current and self.display:
            x, y, width, height = self.region
            if self.screen.region.contains_region(self.region) and width and height:
                self._write(at_cell(x, y, self._sixels))

    def _write(self, data: str) -> None:
        driver = self.app._driver
        if driver is not None and not driver.is_headless:
            driver.write(data)


def centred(text: str, width: int, height: int) -> list[str]:
    """Left-aligned lines centred as a block and cropped to the area."""
    lines = [printable(line) for line in text.splitlines()][:height]
    indent = " " * (max(0, width - max(map(len, lines), default=0)) // 2)
    return [""] * ((height - len(lines)) // 2) + [f"{indent}{line}"[:width] for line in lines]


def _half_blocks(cells: Cells) -> list[Strip]:
    levels = cells.levels.astype(int) * GREYS // 256
    levels[cells.lines > 0] = GREYS - 1 + cells.lines[cells.lines > 0]
    strips = []
    for row in range(len(levels) // 2):
        pairs = zip(levels[2 * row].tolist(), levels[2 * row + 1].tolist(), strict=True)
        segments = [
            Segment("+", MARK) if (row, column) in cells.marked else Segment("▀", _half_block(upper, lower))
            for column, (upper, lower) in enumerate(pairs)
        ]
        strips.append(Strip(Segment.simplify(segments), levels.shape[1]))
    return strips


class CurveView(Drawn):
    """Curves in characters; `plot(width, height, ascii)` gives the lines."""

    plot: Callable[[int, int, bool], list[str]] | None = None

    def show(self, plot: Callable[[int, int, bool], list[str]] | None) -> None:
        self.plot = plot
        self.redraw()

    def draw(self, width: int, height: int) -> tuple[Strip, ...]:
        lines = self.plot(width, height, self.glyphs.ascii) if self.plot is not None else []
        return tuple(_text_strip(line) for line in lines)


class BigText(Drawn):
    """Digits and signs as large as possible."""

    text = ""

    def show(self, text: str) -> None:
        self.text = text
        self.redraw()

    def draw(self, width: int, height: int) -> tuple[Strip, ...]:
        return tuple(_text_strip(line) for line in big_lines(self.text, width, height, self.glyphs.full))


def _text_strip(text: str) -> Strip:
    return Strip([Segment(text, PLAIN)])


class Rail(Part):
    """The list of steps with a mark and a value for each."""

    def show(self, plan: Plan, done: Mapping[str, str], now: str | None) -> None:
        """Show the progress of a plan: `done` maps completed steps to their values."""
        width = max(8, self.size.width or 24)
        self.update(
            lines_of(
                literal(plan.title, "bold"), "", *(self._entry(s.name, s.title, done, now, width) for s in plan.steps)
            )
        )

    def _entry(self, name: str, title: str, done: Mapping[str, str], now: str | None, width: int) -> Content:
        if name == now:
            mark, word, style = self.glyphs.now, "now", "bold reverse"
        elif name in done:
            mark, word, style = self.glyphs.done, self.glyphs.spelt(done[name]) or "done", ""
        else:
            mark, word, style = self.glyphs.todo, "to do", "dim"
        room = width - len(mark) - len(word) - 2
        return literal(f"{mark} {printable(title)[:room]:<{room}} {word}", style)


class Readings(Part):
    """Live numbers with their tolerances and marks."""

    def show(self, readings: Sequence[Reading]) -> None:
        self.update(lines_of(*(line for reading in readings for line in self._entry(reading))))
        self.display = bool(readings)

    def _entry(self, one: Reading) -> tuple[Content, ...]:
        mark = self.glyphs.good if one.good else self.glyphs.bad
        value = f"{value_in_words(one)} {one.unit}".strip()
        first = literal(f"{mark} {one.name}: {value}", "" if one.good else "bold")
        limits = limits_in_words(one)
        lines = (first, literal(f"   {limits}", "dim")) if limits else (first,)
        if one.unit != "°" or one.low is None or one.high is None:
            return lines
        return (
            *lines,
            literal(f"   {angle_level(one.value, one.low, one.high, self.glyphs)}", "" if one.good else "bold"),
        )


LEVEL = 21


def angle_level(value: float, low: float, high: float, glyphs: Glyphs) -> str:
    """An angle as the bubble of a level with its tolerance in brackets; its scale holds the angle and 3 tolerances."""
    end = max(3 * max(abs(low), abs(high)), abs(value)) or 1.0

    def cell(angle: float) -> int:
        return round((angle / end + 1) / 2 * (LEVEL - 1)) if angle == angle else 0

    cells = ["-" if glyphs.ascii else "─"] * LEVEL
    cells[cell(low)], cells[cell(high)] = "[", "]"
    cells[cell(value)] = "O" if glyphs.ascii else "●"
    return "".join(cells)


def value_in_words(reading: Reading) -> str:
    """Its value, to a hundredth of its tolerance."""
    largest = max((abs(limit) for limit in (reading.low, reading.high) if limit), default=0.0)
    places = 3 if not largest else max(0, 2 - math.floor(math.log10(largest)))
    value = round(reading.value, places) + 0.0 if math.isfinite(reading.value) else reading.value
    return f"{value:.0f}" if 1000 <= abs(value) < math.inf else f"{value:.3g}"


def limits_in_words(reading: Reading) -> str:
    """The tolerance: "target 0.7 to 0.9"."""
    if reading.low is None and reading.high is None:
        return ""
    if reading.high is None:
        wanted = f"at least {reading.low:.4g}"
    elif reading.low is None:
        wanted = f"at most {reading.high:.4g}"
    else:
        wanted = f"{reading.low:.3g} to {reading.high:.3g}"
    return f"target {wanted}"


class ProgressLine(Part):
    """The current activity: a sentence, the completed parts, elapsed and remaining time."""

    def __init__(self, clock: Callable[[], float] = time.monotonic, **options: str) -> None:
        super().__init__("", **options)
        self._clock = clock
        self._doing: ProgressEvent | None = None
        self._since_s = 0.0
        self._first: tuple[ProgressEvent, float] | None = None

    def on_mount(self) -> None:
        self.set_interval(1.0, self.tick)

    def show(self, doing: ProgressEvent | None) -> None:
        now_s = self._clock()
        if doing is not None and (self._first is None or self._first[0].say != doing.say):
            self._first = doing, now_s
        self._doing, self._since_s = doing, now_s
        self.tick()
        if doing is None:
            self.update("")

    def hold(self) -> None:
        """Keep the sentence without times."""
        if self._doing is not None:
            self.update(literal(self._doing.say))
            self._doing = None

    def tick(self) -> None:
        if self._doing is not None and self._first is not None:
            first, began_s = self._first
            elapsed_s = self._clock() - self._since_s
            left_s = left_of(first, self._doing, self._since_s - began_s)
            self.update(literal(progress_in_words(self._doing, elapsed_s, left_s, self.glyphs)))


def left_of(first: ProgressEvent, doing: ProgressEvent, took_s: float) -> float | None:
    """Remaining time extrapolated from `first` to `doing`; None where unknown."""
    parts = doing.done - first.done
    if doing.left_s is not None or parts <= 0 or doing.total <= 0:
        return doing.left_s
    return took_s / parts * (doing.total - doing.done)


def progress_in_words(doing: ProgressEvent, elapsed_s: float, left_s: float | None, glyphs: Glyphs) -> str:
    """Bar where parts are counted, sentence, and times."""
    words = [doing.say]
    if doing.total > 0:
        filled = min(BAR, doing.done * BAR // doing.total)
        words = [glyphs.full * filled + glyphs.empty * (BAR - filled), f"{doing.done} of {doing.total}", doing.say]
    if left_s is not None and left_s > elapsed_s:
        words.append(f"about {seconds_in_words(left_s - elapsed_s)} left")
    elif elapsed_s >= 2:
        words.append(f"({seconds_in_words(elapsed_s)} so far)")
    return "  ".join(words)


def seconds_in_words(seconds: float) -> str:
    """12 s, 3 min 20 s."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"


def verdict_words(verdict: str, glyphs: Glyphs) -> str:
    """A measurement's verdict as mark and text."""
    marks: Mapping[str, str] = {"pass": glyphs.good, "refused": glyphs.bad}
    return f"{marks.get(verdict, '?')} {measurement_words(verdict)}"
