"""The two lines at the foot of every screen: the devices with the way to stop them, and the keys."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, cast

from textual.content import Content

from station.app.widgets import Part, lines_of, literal
from station.bench.axis_text import label, position_text

if TYPE_CHECKING:
    from textual.geometry import Size

    from drivers.interfaces import Condition
    from station.app.commands import Offers
    from station.bench.stage_watch import DeviceState

WIDE = 110  # columns from which there is room for words beside the names


def packed(parts: Sequence[Content], width: int) -> Content:
    """Parts side by side, in lines that end between two of them: Textual breaks lines at no-break spaces too."""
    lines: list[Content] = []
    for part in parts:
        longer = Content("  ").join([*lines[-1:], part])
        lines[-1:] = [longer] if longer.cell_length <= width or not lines else [*lines[-1:], part]
    return lines_of(*lines)


class DeviceBar(Part):
    """Every device with its mark; those that cannot be used come first and say why. The way to stop them all.

    Its lines are made when the width is asked of it, not when a device changes: before the first layout there is none.
    """

    _told: tuple[Sequence[DeviceState], str] = ((), "")

    def show(self, states: Sequence[DeviceState], words: str) -> None:
        """How the devices are; `words` where there are none."""
        told = tuple(states), words
        if told != self._told:
            self._told = told
            self.refresh(layout=True)

    def render(self) -> Content:
        """The lines at the width it has."""
        return self._lines(self.size.width)

    def get_content_height(self, container: Size, viewport: Size, width: int) -> int:
        """As many lines as the devices take at this width."""
        return len(self._lines(width).split())

    def _lines(self, width: int) -> Content:
        states, words = self._told
        stop = literal(" F12 STOP ALL ", "bold reverse")
        moving = [one for one in states if one.moving]
        bad = [one for one in states if not one.condition.usable and not one.moving]
        parts = [literal(f"{self.glyphs.now} {one.name}: {one.condition.word}", "bold reverse") for one in moving]
        parts += [literal(f"{self.glyphs.bad} {one.name}: {_why(one)}.", "bold") for one in bad]
        parts += self._usable([one for one in states if one.condition.usable and not one.moving], width)
        return packed([stop, *(parts or [literal(words)])], width)

    def _usable(self, states: Sequence[DeviceState], width: int) -> list[Content]:
        if width >= WIDE:
            return [literal(f"{self.glyphs.good} {one.name}: {one.condition.word}") for one in states]
        names = " ".join(one.name for one in states)
        return [literal(f"{self.glyphs.good} {names}")] if states else []


def brief(condition: Condition) -> str:
    """A device's condition beside its name, which need not be told twice: "not homed"."""
    return condition.word.removeprefix("the stage is ")


def _why(one: DeviceState) -> str:
    """Why a device cannot be used; of a stage that may not move, where it was told to be last."""
    told = ", ".join(f"{label(axis)} {position_text(axis, place)}" for axis, place in one.places.items())
    return brief(one.condition) + (f" (last told: {told})" if told else "")


class KeyLine(Part):
    """The keys of this screen: as many as there is room for."""

    def on_mount(self) -> None:
        """Fill it when the width is known."""
        self.call_after_refresh(self.show)

    def on_resize(self) -> None:
        """Another width, another choice."""
        self.show()

    def show(self) -> None:
        """Write the keys that can be pressed now."""
        entries: list[Content] = []
        room = self.size.width
        for command in cast("Offers", self.app).offered():
            entry = Content.assemble((command.pair or command.key_name(), "bold reverse"), f" {command.word}")
            if command.word and entry.cell_length <= room:
                room -= entry.cell_length + 2
                entries.append(entry)
        self.update(Content("  ").join(entries), layout=False)  # it is one line, whatever it says
