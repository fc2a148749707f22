"""An operator who does what is asked and answers as written down: for batch runs, the demonstration and tests."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from procedures.plan import Ask, Fact
from station.guide.frontend import Event, Stopped

Answer = Fact | Callable[[Ask], Fact]
TROUBLE, LOOK = "trouble", "look"
LOOKS = 3
"""So often it looks on where a check is not content; then it goes on with what is."""


@dataclass
class ScriptedOperator:
    """Confirms everything; other questions are answered by their key, else by their default.

    Attributes
    ----------
    answers : by key: a fact, or what gives one when asked
    patience : so many troubles are tried again; the next one ends the run
    heard, asked : all that was told and asked, in order
    """

    answers: Mapping[str, Answer] = field(default_factory=dict)
    patience: int = 20
    listen: Callable[[Event], None] = lambda event: None
    heard: list[Event] = field(default_factory=list)
    asked: list[Ask] = field(default_factory=list)

    def notify(self, event: Event) -> None:
        """Note it down."""
        self.heard.append(event)
        self.listen(event)

    def count(self, key: str) -> int:
        """How often this was asked."""
        return sum(ask.key == key for ask in self.asked)

    def answer(self, ask: Ask) -> Fact:
        """What is written down for it. Raises Stopped where nothing is and there is no default."""
        self.asked.append(ask)
        if ask.key == TROUBLE and self.count(TROUBLE) > self.patience:
            raise Stopped
        if ask.key == LOOK and LOOK not in self.answers and self.count(LOOK) > LOOKS:
            return ask.choices[1]
        if ask.key in self.answers:
            given = self.answers[ask.key]
            return given(ask) if callable(given) else given
        if ask.default is not None:
            return ask.default
        if ask.kind == "confirm":
            return True
        raise Stopped
