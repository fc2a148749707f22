"""The two bars at the bottom of every screen: the devices with the key that stops them, and the keys."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, cast

from textual.content import Content

from station.app.widgets import Part, lines_of, literal
from station.bench.axis_text import label, position_text

if TYPE_CHECKING:
    from textual.geometry import Size

    from drivers.interfaces import Condition
    from station.app.commands import CommandSource
    from station.bench.stage_watch import DeviceState

WIDE = 110  # columns from which conditions are shown in addition to names


def packed(parts: Sequence[Content], width: int) -> Content:
    """Parts wrapped into lines only between parts; Textual also breaks lines at no-break spaces."""
    lines: list[Content] = []
    for part in parts:
        longer = Content("  ").join([*lines[-1:], part])
        lines[-1:] = [longer] if longer.cell_length <= width or not lines else [*lines[-1:], part]
    return lines_of(*lines)


class DeviceBar(Part):
    """Every device with its mark, unusable ones first with the reason, and the key that stops all of them. Its lines
    are made for a given width, not when a device changes, since the width is unknown before the first layout."""

    _shown: tuple[Sequence[DeviceState], str] = ((), "")

    def show(self, states: Sequence[DeviceState], words: str) -> None:
        """Show the devices; `words` if there are none."""
        shown = tuple(states), words
        if shown != self._shown:
            self._shown = shown
            self.refresh(layout=True)

    def render(self) -> Content:
        return self._lines(self.size.width)

    def get_content_height(self, container: Size, viewport: Size, width: int) -> int:
        return len(self._lines(width).split())

    def _lines(self, width: int) -> Content:
        states, words = self._shown
        stop = literal(" F12 STOP ALL ", "bold reverse")
        moving = [state for state in states if state.moving]
        bad = [state for state in states if not state.condition.usable and not state.moving]
        parts = [literal(f"{self.glyphs.now} {one.name}: {one.condition.word}", "bold reverse") for one in moving]
        parts += [literal(f"{self.glyphs.bad} {one.name}: {_why(one)}.", "bold") for one in bad]
        usable = [state for state in states if state.condition.usable and not state.moving]
        if width >= WIDE:
            parts += [literal(f"{self.glyphs.good} {one.name}: {one.condition.word}") for one in usable]
        elif usable:
            parts.append(literal(f"{self.glyphs.good} {' '.join(one.name for one in usable)}"))
        return packed([stop, *(parts or [literal(words)])], width)


def brief(condition: Condition) -> str:
    """A device's condition without the repeated name: "not homed"."""
    return condition.word.removeprefix("the stage is ")


def _why(state: DeviceState) -> str:
    """Why a device cannot be used, and the last reported position of a stage."""
    last = ", ".join(f"{label(axis)} {position_text(axis, place)}" for axis, place in state.places.items())
    return brief(state.condition) + (f" (last position: {last})" if last else "")


class KeyLine(Part):
    """The keys of this screen that fit."""

    def on_mount(self) -> None:
        """Fill it once the width is known."""
        self.call_after_refresh(self.show)

    def on_resize(self) -> None:
        self.show()

    def show(self) -> None:
        entries: list[Content] = []
        room = self.size.width
        for command in cast("CommandSource", self.app).offered():
            entry = Content.assemble((command.pair or command.key_name(), "bold reverse"), f" {command.word}")
            if command.word and entry.cell_length <= room:
                room -= entry.cell_length + 2
                entries.append(entry)
        self.update(Content("  ").join(entries), layout=False)  # always one line
