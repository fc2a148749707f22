"""Help, and modal questions."""

from collections.abc import Sequence
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical, VerticalScroll
from textual.screen import ModalScreen

from station.app.commands import Command
from station.app.screens.parts import Choices
from station.app.widgets import Part, lines_of, literal
from station.manual.pages import find_page, for_terminal, read_pages

GLOSSARY = "glossary"
"""The manual's page that help ends with."""
HEAD = "Help: Escape closes this, the arrows scroll it"
INTRODUCTION = """\
The guide (F2) leads from the printed chart to the report, one step at a time. The box always shows what to do next; \
press Enter when it is done. The list on the left shows the completed steps with their values, the current step, and \
the steps to do.
F12 stops every device, on every screen. It is a convenience, not a safety device: install a switch that cuts the \
motors' power.
Every photograph is stored at once; you can quit the program at any time and continue later."""


class Dialog(ModalScreen[int | None]):
    """A box over the screen; Escape closes it."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape", "close", show=False)]

    def close(self, answer: int | None) -> None:
        """Return the answer and close, once, and only if this dialog is on top: keys may be faster than screens."""
        if self.is_current and not self._left:
            self._left = True
            self.dismiss(answer)

    def action_close(self) -> None:
        """Close without an answer."""
        self.close(None)

    _left = False


class Help(Dialog):
    """The open question, the keys, and the glossary."""

    def __init__(self, commands: Sequence[type[Command]], question: Sequence[str] = ()) -> None:
        super().__init__()
        self._commands, self._question = commands, question

    def compose(self) -> ComposeResult:
        keys = [f"{command.key_name():>4}  {command.help()}" for command in self._commands]
        with Vertical(), VerticalScroll():
            yield Part(id="help-question")
            yield Part(id="introduction")
            yield Part(id="help-keys")
            yield Part(id="help-words")
        self._lines = keys

    def on_mount(self) -> None:
        question = [literal(line, "" if i else "bold") for i, line in enumerate((*self._question, ""))]
        self.query_one("#help-question", Part).update(lines_of(literal(HEAD, "bold"), *question))
        self.query_one("#introduction", Part).update(lines_of(*INTRODUCTION.split("\n"), ""))
        self.query_one("#help-keys", Part).update(lines_of(*self._lines, ""))
        heading, *lines = paragraphs_of(for_terminal(find_page(read_pages(), GLOSSARY).text))
        self.query_one("#help-words", Part).update(lines_of(literal(heading.removeprefix("# "), "bold"), *lines))


def paragraphs_of(markdown: str) -> list[str]:
    """A page of Markdown as lines without markup: one per paragraph, drawings unchanged."""
    lines: list[str] = []
    drawn = goes_on = False
    for line in markdown.splitlines():
        if line.startswith("```"):
            drawn, goes_on = not drawn, False
            continue
        words = line if drawn else line.replace("**", "").replace("`", "")
        if goes_on and words:
            lines[-1] += f" {words}"
        else:
            lines.append(words)
        goes_on = bool(words) and not drawn
    return lines


class Choose(Dialog):
    """A question with a few answers; gives the index of the chosen one.

    moves : whether an answer starts a movement; then only Enter answers, and an emergency stop closes the question
    """

    def __init__(self, question: str, answers: Sequence[str], *, moves: bool = False) -> None:
        super().__init__()
        self._question, self._answers, self.moves = question, answers, moves

    def compose(self) -> ComposeResult:
        with Vertical():
            yield Part(self._question)
            yield Choices(self._answers, id="answers")

    def on_mount(self) -> None:
        self.query_one(Choices).by_enter_alone = self.moves
        self.query_one(Choices).focus()

    def on_choices_chosen(self, event: Choices.Chosen) -> None:
        self.close(event.index)
