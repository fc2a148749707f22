"""A scripted operator with prepared answers: for batch runs, the demonstration and tests."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from procedures.plan import Ask, Fact
from station.guide.frontend import Event, Stopped

Answer = Fact | Callable[[Ask], Fact]
TROUBLE, LOOK = "trouble", "look"
MAX_LOOKS = 3
"""Repeats of a failing check before it goes on unchanged."""


@dataclass
class ScriptedOperator:
    """Confirms everything, and answers other questions by their key, else by their default.

    answers : by key: a fact, or a function of the question that gives one
    patience : number of problems that are retried; the next one ends the run
    heard, asked : all events and questions, in order
    """

    answers: Mapping[str, Answer] = field(default_factory=dict)
    patience: int = 20
    listen: Callable[[Event], None] = lambda event: None
    heard: list[Event] = field(default_factory=list)
    asked: list[Ask] = field(default_factory=list)

    def notify(self, event: Event) -> None:
        """Record the event."""
        self.heard.append(event)
        self.listen(event)

    def count(self, key: str) -> int:
        """Number of times this was asked."""
        return sum(ask.key == key for ask in self.asked)

    def answer(self, ask: Ask) -> Fact:
        """The prepared answer. Raises Stopped where there is neither one nor a default."""
        self.asked.append(ask)
        if ask.key == TROUBLE and self.count(TROUBLE) > self.patience:
            raise Stopped
        if ask.key == LOOK and LOOK not in self.answers and self.count(LOOK) > MAX_LOOKS:
            return ask.choices[1]
        if ask.key in self.answers:
            given = self.answers[ask.key]
            return given(ask) if callable(given) else given
        if ask.default is not None:
            return ask.default
        if ask.kind == "confirm":
            return True
        raise Stopped
