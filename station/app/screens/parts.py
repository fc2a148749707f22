"""What the screens share: their frame, choices by key, and the box where the guide's questions are answered."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.events import Key
from textual.message import Message
from textual.screen import Screen
from textual.widgets import Input

from station.app.bars import DeviceBar, KeyLine
from station.app.commands import Command
from station.app.widgets import SPACE, Part, lines_of, literal

if TYPE_CHECKING:
    from procedures.plan import Ask, Fact
    from station.app.background import Finished


DONE = "done: press Enter"
READ_S = 0.4
"""A question before a move is not answered sooner than it can have been read: Enter may have been held down."""
MOVES = "clear: Enter moves, F12 stops"
AHEAD_S = 1.0
"""So long before a question, what is typed is meant for it: half a number would be another number."""
OF_NUMBERS = "0123456789.,-"


class StationScreen(Screen[None]):
    """A screen with the devices, the emergency stop and the keys always in sight."""

    COMMANDS_HERE: ClassVar[tuple[type[Command], ...]] = ()

    class Ready(Message):
        """Its parts are there: it can be told what to show."""

        def __init__(self, screen: StationScreen) -> None:
            super().__init__()
            self.screen = screen

    def body(self) -> ComposeResult:
        """What is between title and devices."""
        raise NotImplementedError

    def compose(self) -> ComposeResult:
        """Title, body, devices, keys."""
        yield Part(id="title")
        yield from self.body()
        yield DeviceBar(id="devices")
        yield KeyLine(id="keys")

    def on_mount(self) -> None:
        """Show what the application knows already."""
        self.refresh_frame()
        self.post_message(self.Ready(self))

    def on_screen_resume(self) -> None:
        """Show what has changed while another screen was shown."""
        self.refresh_frame()

    def refresh_frame(self) -> None:
        """Devices, title and keys as they are now."""
        self.app.fill_frame(self)  # type: ignore[attr-defined]

    def can(self, command: type[Command]) -> bool:
        """Whether a command of this screen can be given now."""
        return True

    def done(self, finished: Finished) -> None:
        """What came of work on a screen's behalf."""


class Choices(Part, can_focus=True):
    """A few lines, one of them chosen: by arrows and Enter, or by its number."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up,left", "move(-1)", show=False),
        Binding("down,right", "move(1)", show=False),
        Binding("enter", "take", show=False),
        Binding("space", "take_lightly", show=False),
        *(Binding(str(n), f"number({n})", show=False) for n in range(1, 10)),
    ]

    class Chosen(Message):
        """One was taken: its place in the list."""

        def __init__(self, choices: Choices, index: int) -> None:
            super().__init__()
            self.choices, self.index = choices, index

    class Beyond(Message):
        """An arrow was pressed at the end of the list: by how much it would have led beyond."""

        def __init__(self, by: int) -> None:
            super().__init__()
            self.by = by

    class Moved(Message):
        """Another one is chosen, and not taken yet."""

        def __init__(self, index: int) -> None:
            super().__init__()
            self.index = index

    def __init__(self, lines: Sequence[str] = (), **options: str) -> None:
        super().__init__("", **options)
        self.lines, self.at = list(lines), 0
        self.by_enter_alone = False
        """Whether neither the space bar nor a number takes a line: what follows must be meant."""
        self.pressed_s = 0.0
        """When the last key was pressed, which may be some time before it is heard."""

    def on_mount(self) -> None:
        """Show them."""
        self.set_lines(self.lines)

    def set_lines(self, lines: Sequence[str], at: int = 0, *, by_enter_alone: bool = False) -> None:
        """Other lines, with the one at `at` chosen."""
        self.lines, self.at, self.by_enter_alone = list(lines), at, by_enter_alone
        self._show()

    def _show(self) -> None:
        several = len(self.lines) > 1
        shown = []
        for i, line in enumerate(self.lines):
            mark = self.glyphs.now if i == self.at else " " * len(self.glyphs.now)
            number = f"{i + 1}{SPACE}" if several and i < 9 else ""
            style = "bold reverse" if i == self.at and self.has_focus else ""
            shown.append(literal(f"{mark}{SPACE}{number}{line}", style))
        self.update(lines_of(*shown))

    def on_key(self, event: Key) -> None:
        """Note when it was pressed."""
        self.pressed_s = event.time

    def on_focus(self) -> None:
        """Make it seen."""
        self._show()

    def on_blur(self) -> None:
        """Make it seen."""
        self._show()

    def action_move(self, by: int) -> None:
        """Up and down, staying at the ends."""
        before, self.at = self.at, min(max(self.at + by, 0), max(len(self.lines) - 1, 0))
        self._show()
        self.scroll_visible(animate=False)
        self.post_message(self.Moved(self.at) if self.at != before else self.Beyond(by))

    def action_take(self) -> None:
        """The one that is chosen."""
        if self.lines:
            self.post_message(self.Chosen(self, self.at))

    def action_take_lightly(self) -> None:
        """The one that is chosen, by the space bar."""
        if not self.by_enter_alone:
            self.action_take()

    def action_number(self, number: int) -> None:
        """The one of that number."""
        if number <= len(self.lines) and not self.by_enter_alone:
            self.at = number - 1
            self._show()
            self.action_take()


class Line(Input):
    """A line to type into, which keeps what is typed when it is come back to."""

    def __init__(self, **options: Any) -> None:
        super().__init__(select_on_focus=False, **options)
        self.pressed_s = 0.0
        """When the last key was pressed, which may be some time before it is heard."""

    def on_key(self, event: Key) -> None:
        """Note when it was pressed."""
        self.pressed_s = event.time


class AnswerBox(Vertical):
    """What to do next, in one sentence; below it, where a question is open, the means to answer it.

    What is asked has the focus at once, not when the loop comes to it: a key that came between would be lost. Digits
    that were typed shortly before a number is asked for begin it; Enter pressed before it was asked for is no answer.
    """

    class Given(Message):
        """An answer."""

        def __init__(self, fact: Fact) -> None:
            super().__init__()
            self.fact = fact

    _ask: Ask | None = None
    _asked_s = 0.0
    _shown_s = math.inf
    _ahead: tuple[Key, ...] = ()
    _offers: Sequence[type[Command]] = ()

    def compose(self) -> ComposeResult:
        """The sentence, what is wrong with the answer, and both ways to answer."""
        yield Part(id="next")
        yield Part(id="wrong")
        yield Line(id="typed", compact=True)
        yield Choices(id="choices")

    def on_mount(self) -> None:
        """Nothing is asked yet."""
        self.set_class(self.app.glyphs.ascii, "-ascii")  # type: ignore[attr-defined]
        self.tell("")

    @property
    def open(self) -> bool:
        """Whether a question waits."""
        return self._ask is not None

    @property
    def question(self) -> str:
        """The question that waits; empty where none does."""
        return self._ask.question if self._ask is not None else ""

    def tell(self, sentence: str) -> None:
        """No question: a sentence only."""
        self._ask, self._offers = None, ()
        self._show(sentence)

    def type_ahead(self, event: Key) -> None:
        """A key that was pressed while nothing is asked."""
        if not self.open and event.character is not None and event.character in OF_NUMBERS:
            self._ahead = (*self._ahead[-20:], event)

    def _typed_ahead(self) -> str:
        """What was typed shortly before now."""
        ahead, self._ahead = self._ahead, ()
        return "".join(key.character or "" for key in ahead if self._asked_s - key.time < AHEAD_S)

    def ask(self, ask: Ask) -> None:
        """A question, with its usual answer ready."""
        from station.guide.answers import words

        self._ask, self._shown_s = ask, math.inf
        self.call_after_refresh(self._note_shown)
        typed = ask.kind in ("number", "text")
        self._show(ask.question + _wanted(ask), "#typed" if typed else "#choices")
        ahead = self._typed_ahead()
        if typed:
            box = self.query_one(Line)
            begun = ahead if ask.kind == "number" else ""
            box.value = begun or words(ask.default)
            if begun:
                box.action_end()
            else:
                box.action_select_all()  # typing replaces what is proposed
        else:
            choices = self.query_one(Choices)
            from station.guide.frontend import MOVE

            lines = ask.choices if ask.kind == "choice" else (MOVES if ask.key == MOVE else DONE,)
            at = lines.index(str(ask.default)) if str(ask.default) in lines else 0
            choices.set_lines(lines, at, by_enter_alone=ask.key == MOVE)

    def _note_shown(self) -> None:
        self._shown_s = Message().time

    def offer(self, sentence: str, offers: Mapping[str, type[Command]]) -> None:
        """What can be done next: commands, by what they are called here."""
        self._ask, self._offers = None, list(offers.values())
        self._show(sentence, "#choices")
        lines = [f"{words} ({command.key_name()})" for words, command in offers.items()]
        self.query_one(Choices).set_lines(lines)

    def _show(self, sentence: str, means: str = "") -> None:
        """A sentence, and the means to answer it by, which has the focus; none has it where there is none."""
        self._asked_s = Message().time  # by the clock that keys are timed with
        self.query_one("#next", Part).update(literal(sentence, "bold"))
        self.query_one("#wrong", Part).say("")
        for one in (self.query_one(Line), self.query_one(Choices)):
            one.display = f"#{one.id}" == means
        self.screen.set_focus(self.query_one(means) if means else None)

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """What was typed."""
        event.stop()
        if self.query_one(Line).pressed_s >= self._asked_s:
            self._answer(event.value)

    def on_choices_chosen(self, event: Choices.Chosen) -> None:
        """What was chosen."""
        event.stop()
        if event.choices.pressed_s < self._asked_s:
            return
        if self._offers:
            self.screen.post_message(self._offers[event.index]())
            return
        self._answer(str(event.index + 1) if self._ask and self._ask.kind == "choice" else "")

    def _answer(self, text: str) -> None:
        if self._ask is None:
            return
        from station.guide.answers import parse
        from station.guide.frontend import MOVE

        if self._ask.key == MOVE and self.query_one(Choices).pressed_s - self._shown_s < READ_S:
            return  # the key was meant for what stood there before
        try:
            fact = parse(self._ask, text)
        except ValueError as error:
            self.query_one("#wrong", Part).say(str(error))
            return
        self.tell("One moment.")
        self.post_message(self.Given(fact))


def _wanted(ask: Ask) -> str:
    """Unit and limits of a number: " (50 to 2000 mm)"."""
    if ask.kind != "number":
        return ""
    from station.guide.answers import plain

    ends = [plain(end) for end in (ask.low, ask.high) if end is not None]
    if len(ends) == 1:
        ends.insert(0, "at most" if ask.low is None else "at least")
        told = " ".join(ends)
    else:
        told = " to ".join(ends)
    told = f"{told} {ask.unit}".strip()
    return f" ({told})" if told else ""
