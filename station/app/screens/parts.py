"""Common parts of the screens: the frame, choices by key, and the box for the guide's questions."""

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
from station.app.widgets import Part, lines_of, literal

if TYPE_CHECKING:
    from procedures.plan import Ask, Fact, Step
    from station.app.background import Finished
    from station.bench.opening import Bench
    from station.guide.frontend import Consent


DONE = "done: press Enter"
MIN_READ_S = 0.4
"""Earlier answers to a question before a move are ignored: Enter may have been held down."""
TYPE_AHEAD_S = 1.0
"""Digits typed within this time before a question belong to its answer."""
ALONE_S = 0.03
"""Time without another key after which a number chooses a line."""
NUMBER_CHARACTERS = "0123456789.,-"


TOO_SMALL = "This window is too small: make it 60 columns wide and 15 lines high. F12 stops all, Ctrl+Q leaves."


class StationScreen(Screen[None]):
    """A screen that always shows the devices, the emergency stop and the keys."""

    COMMANDS_HERE: ClassVar[tuple[type[Command], ...]] = ()

    class Ready(Message):
        """The screen is mounted and can show entries."""

        def __init__(self, screen: StationScreen) -> None:
            super().__init__()
            self.screen = screen

    def body(self) -> ComposeResult:
        raise NotImplementedError

    def compose(self) -> ComposeResult:
        yield Part(TOO_SMALL, id="too-small")
        yield Part(id="title")
        yield from self.body()
        yield DeviceBar(id="devices")
        yield KeyLine(id="keys")

    def on_mount(self) -> None:
        self.refresh_frame()
        self.post_message(self.Ready(self))

    def on_screen_resume(self) -> None:
        self.refresh_frame()

    def refresh_frame(self) -> None:
        self.app.fill_frame(self)  # type: ignore[attr-defined]

    @property
    def bench(self) -> Bench | None:
        """The application's bench."""
        bench: Bench | None = self.app.bench  # type: ignore[attr-defined]
        return bench

    def can(self, command: type[Command]) -> bool:
        return True

    def question_help(self) -> Sequence[str]:
        return ()

    def done(self, finished: Finished) -> None:
        """Handle the end of a job of the screen."""


class Choices(Part, can_focus=True):
    """A list of lines, chosen by arrows and Enter, or by number."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up,left", "move(-1)", show=False),
        Binding("down,right", "move(1)", show=False),
        Binding("enter", "take", show=False),
        Binding("space", "take_lightly", show=False),
        *(Binding(str(n), f"number({n})", show=False) for n in range(1, 10)),
    ]

    class Chosen(Message):
        """A line was chosen, by its index."""

        def __init__(self, choices: Choices, index: int) -> None:
            super().__init__()
            self.choices, self.index = choices, index

    class Beyond(Message):
        """An arrow was pressed at the end of the list; `by` is its direction."""

        def __init__(self, by: int) -> None:
            super().__init__()
            self.by = by

    class Moved(Message):
        """Another line is highlighted."""

        def __init__(self, index: int) -> None:
            super().__init__()
            self.index = index

    def __init__(self, lines: Sequence[str] = (), **options: str) -> None:
        super().__init__("", **options)
        self.lines, self.at = list(lines), 0
        self.by_enter_alone = False
        """Whether only Enter chooses a line, not the space bar or a number, to avoid accidental moves."""
        self.pressed_s = 0.0
        """Time at which the last key was pressed, which may be earlier than its handling."""

    def on_mount(self) -> None:
        self.set_lines(self.lines)

    def set_lines(self, lines: Sequence[str], at: int = 0, *, by_enter_alone: bool = False) -> None:
        """Show other lines, with the one at index `at` highlighted."""
        self.lines, self.at, self.by_enter_alone = list(lines), at, by_enter_alone
        self._show()

    def _show(self) -> None:
        several = len(self.lines) > 1
        rows = []
        for i, line in enumerate(self.lines):
            mark = self.glyphs.now if i == self.at and self.has_focus else " " * len(self.glyphs.now)
            number = f"{i + 1}{self.glyphs.space}" if several and i < 9 else ""
            style = "bold reverse" if i == self.at and self.has_focus else ""
            rows.append(literal(f"{mark}{self.glyphs.space}{number}{line}", style))
        self.update(lines_of(*rows))

    def on_key(self, event: Key) -> None:
        self.pressed_s = event.time

    def watch_has_focus(self, focused: bool) -> None:
        """Show the cursor in the list that has the focus, and in no other."""
        super().watch_has_focus(focused)
        self._show()

    def action_move(self, by: int) -> None:
        before, self.at = self.at, min(max(self.at + by, 0), max(len(self.lines) - 1, 0))
        self._show()
        self.scroll_visible(animate=False)
        self.post_message(self.Moved(self.at) if self.at != before else self.Beyond(by))

    def action_take(self) -> None:
        if self.lines:
            self.post_message(self.Chosen(self, self.at))

    def action_take_lightly(self) -> None:
        if not self.by_enter_alone:
            self.action_take()

    def action_number(self, number: int) -> None:
        """Choose a line by its number, unless more keys follow at once, as from a pasted text."""
        if number <= len(self.lines) and not self.by_enter_alone:
            self.at = number - 1
            self._show()
            pressed_s = self.pressed_s
            self.set_timer(ALONE_S, lambda: self.action_take() if self.pressed_s == pressed_s else None)


class InputLine(Input):
    """An input line that keeps its text when it regains the focus."""

    def __init__(self, **options: Any) -> None:
        super().__init__(select_on_focus=False, **options)
        self.pressed_s = 0.0
        """Time at which the last key was pressed, which may be earlier than its handling."""

    def on_key(self, event: Key) -> None:
        self.pressed_s = event.time


class AnswerBox(Vertical):
    """The next instruction in one sentence, and below it the input for an open question.

    The input takes the focus immediately, so that no key is lost. Digits typed shortly before a question for a number
    begin its answer; Enter pressed before the question is ignored.
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
        """The sentence, the error of the last answer, input line and choices."""
        yield Part(id="next")
        yield Part(id="wrong")
        yield InputLine(id="typed", compact=True)
        yield Choices(id="choices")

    def on_mount(self) -> None:
        """Begin without a question."""
        self.set_class(self.app.glyphs.ascii, "-ascii")  # type: ignore[attr-defined]
        self.show_sentence("")

    @property
    def question(self) -> str:
        """The open question, empty if none is."""
        return "" if self._ask is None else self._ask.question

    @property
    def open(self) -> bool:
        return self._ask is not None

    def explain(self, step: Step | None = None) -> Sequence[str]:
        from station.guide.question_help import explain

        return () if self._ask is None else explain(self._ask, step)

    def show_sentence(self, sentence: str) -> None:
        """Show a sentence without a question."""
        self._ask, self._offers = None, ()
        self._show(sentence)

    def type_ahead(self, event: Key) -> None:
        if not self.open and event.character is not None and event.character in NUMBER_CHARACTERS:
            self._ahead = (*self._ahead[-20:], event)

    def _note_shown(self) -> None:
        self._shown_s = Message().time

    def ask(self, ask: Ask) -> None:
        from station.guide.answers import words

        self._ask, self._shown_s = ask, math.inf
        self.call_after_refresh(self._note_shown)
        typed = ask.kind in ("number", "text")
        self._show(ask.question + _wanted(ask), "#typed" if typed else "#choices")
        keys, self._ahead = self._ahead, ()
        ahead = "".join(key.character or "" for key in keys if self._asked_s - key.time < TYPE_AHEAD_S)
        if typed:
            box = self.query_one(InputLine)
            begun = ahead if ask.kind == "number" else ""
            box.value = begun or words(ask.default)
            if begun:
                box.action_end()
            else:
                box.action_select_all()  # typing replaces the default
        else:
            choices = self.query_one(Choices)
            from station.guide.frontend import BY_HAND, NOT_NOW

            consent = _consent(ask)
            lines = ask.choices if ask.kind == "choice" else (DONE, NOT_NOW) if ask.key == BY_HAND else (DONE,)
            if consent is not None:
                lines = (f"clear: press Enter to {consent.start}; F12 stops", NOT_NOW)
            at = lines.index(str(ask.default)) if str(ask.default) in lines else 0
            choices.set_lines(lines, at, by_enter_alone=consent is not None)

    def offer(self, sentence: str, offers: Mapping[str, type[Command]]) -> None:
        self._ask, self._offers = None, list(offers.values())
        self._show(sentence, "#choices")
        lines = [f"{words} ({command.key_name()})" for words, command in offers.items()]
        self.query_one(Choices).set_lines(lines)

    def _show(self, sentence: str, means: str = "") -> None:
        """Show a sentence and focus the widget for the answer, if any."""
        self._asked_s = Message().time  # by the clock of the keys
        self.query_one("#next", Part).update(literal(sentence, "bold"))
        self.query_one("#wrong", Part).say("")
        for widget in (self.query_one(InputLine), self.query_one(Choices)):
            widget.display = f"#{widget.id}" == means
        self.screen.set_focus(self.query_one(means) if means else None)

    def on_input_submitted(self, event: Input.Submitted) -> None:
        event.stop()
        if self.query_one(InputLine).pressed_s >= self._asked_s:
            self._answer(event.value)

    def on_choices_chosen(self, event: Choices.Chosen) -> None:
        event.stop()
        if event.choices.pressed_s < self._asked_s:
            return
        if self._offers:
            self.screen.post_message(self._offers[event.index]())
            return
        self._answer(str(event.index + 1) if self._ask and self._ask.kind == "choice" else ("yes", "no")[event.index])

    def _answer(self, text: str) -> None:
        if self._ask is None:
            return
        from station.guide.answers import parse

        if _consent(self._ask) and (pressed_s := self.query_one(Choices).pressed_s) - self._shown_s < MIN_READ_S:
            self._shown_s = max(self._shown_s, pressed_s)  # a key that is held down never answers
            return  # the key was pressed before the question could be read
        try:
            fact = parse(self._ask, text)
        except ValueError as error:
            self.query_one("#wrong", Part).say(str(error))
            return
        self.show_sentence("One moment.")
        self.post_message(self.Given(fact))


def _consent(ask: Ask) -> Consent | None:
    """How a question for consent is asked; None for other questions."""
    from station.guide.frontend import CONSENTS

    return CONSENTS.get(ask.key)


def _wanted(ask: Ask) -> str:
    """Checks before a consent; unit and limits of a number: " (50 to 2000 mm)"."""
    if consent := _consent(ask):
        return f" {consent.check}"
    if ask.kind != "number":
        return ""
    from station.guide.answers import plain

    ends = [plain(end) for end in (ask.low, ask.high) if end is not None]
    if len(ends) == 1:
        ends.insert(0, "at most" if ask.low is None else "at least")
        limits = " ".join(ends)
    else:
        limits = " to ".join(ends)
    limits = f"{limits} {ask.unit}".strip()
    return f" ({limits})" if limits else ""
