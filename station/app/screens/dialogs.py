"""Help, and the questions that must be answered before anything else."""

from __future__ import annotations

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
The guide (F2) leads from the printed chart to the report, one step at a time. The box always says what to do next; \
Enter says that it is done. The rail on the left shows which steps are done and what they gave, which one is now, \
which are to do.
F12 stops everything, on every screen. It is a convenience, not a safety device: fit a switch that cuts the motors' \
power.
Everything that was photographed is kept at once; the program may be ended at any moment and go on later."""


class Dialog(ModalScreen[int | None]):
    """A box over the screen; Escape closes it."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape", "close", show=False)]

    def close(self, answer: int | None) -> None:
        """Give the answer and go; once, and not from below another dialog: keys come faster than screens leave."""
        if self.is_current and not self._left:
            self._left = True
            self.dismiss(answer)

    def action_close(self) -> None:
        """Without an answer."""
        self.close(None)

    _left = False


class Help(Dialog):
    """What the keys do, and what the words of the screens mean."""

    def __init__(self, commands: Sequence[type[Command]]) -> None:
        super().__init__()
        self._commands = commands

    def compose(self) -> ComposeResult:
        """The introduction, then a line for every key."""
        keys = [f"{command.key_name():>4}  {command.help()}" for command in self._commands]
        with Vertical(), VerticalScroll():
            yield Part(id="introduction")
            yield Part(id="help-keys")
            yield Part(id="help-words")
        self._lines = keys

    def on_mount(self) -> None:
        """Fill it in."""
        paragraphs = INTRODUCTION.split("\n")
        self.query_one("#introduction", Part).update(lines_of(literal(HEAD, "bold"), *paragraphs, ""))
        self.query_one("#help-keys", Part).update(lines_of(*self._lines, ""))
        heading, *lines = paragraphs_of(for_terminal(find_page(read_pages(), GLOSSARY).text))
        self.query_one("#help-words", Part).update(lines_of(literal(heading.removeprefix("# "), "bold"), *lines))


def paragraphs_of(markdown: str) -> list[str]:
    """A page of headings, paragraphs and drawings without its marks: each paragraph one line, drawings as they are."""
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
    """A question with a few answers; gives the place of the one that was taken.

    moves : whether an answer begins a movement; an emergency stop takes such a question back
    """

    def __init__(self, question: str, answers: Sequence[str], *, moves: bool = False) -> None:
        super().__init__()
        self._question, self._answers, self.moves = question, answers, moves

    def compose(self) -> ComposeResult:
        """Question and answers."""
        with Vertical():
            yield Part(self._question)
            yield Choices(self._answers, id="answers")

    def on_mount(self) -> None:
        """The answers have the keyboard."""
        self.query_one(Choices).focus()

    def on_choices_chosen(self, event: Choices.Chosen) -> None:
        """Taken."""
        self.close(event.index)
