"""What the guide does about numbers that cannot all be right, and about moves that mend nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

from procedures.facts import INSISTED
from procedures.plan import Advice, Ask
from station.guide.answers import words
from station.guide.dialogue import STOP, Conversation
from station.guide.frontend import ProblemEvent, Stopped

CORRECT, INSIST, GO_ON = "correct it", "it is right", "go on"
PATIENCE = 3
"""Looks in a row that a move, or another answer, did not make better."""
BETTER = 0.9
"""Of what it is off its tolerance, at most, after a move that mends something."""
REMEDY = "give the numbers anew, or insist that they are right"


@dataclass
class LookProgress:
    """Whether looks get better: of one kind of reading, how far it was off its tolerance at each look in a row."""

    name: str = ""
    off: list[float] = field(default_factory=list)
    values: list[float] = field(default_factory=list)
    doubts: int = 0

    def stalled(self, advice: Advice) -> str:
        """Why going on is useless, "" where it may help: three moves have not brought a reading nearer."""
        bad = next((one for one in advice.readings if not one.good), None)
        if advice.good or not advice.moves or bad is None:
            self.off.clear()
            self.values.clear()
            return ""
        if bad.name != self.name:
            self.name, self.off, self.values = bad.name, [], []
        low, high = bad.value if bad.low is None else bad.low, bad.value if bad.high is None else bad.high
        self.off.append(max(low - bad.value, bad.value - high))
        self.values.append(bad.value)
        last = self.off[-PATIENCE - 1 :]
        if len(last) <= PATIENCE or any(now <= BETTER * before for before, now in pairwise(last)):
            return ""
        told = ", ".join(f"{value:.3g}" for value in self.values[-PATIENCE - 1 :])
        return f"{PATIENCE} moves have not brought the {bad.name} nearer: it was {told} {bad.unit}".rstrip() + "."

    def doubted(self) -> bool:
        """One more answer that did not end a contradiction: whether it has been enough."""
        self.doubts += 1
        return self.doubts >= PATIENCE


def resolve(talk: Conversation, asks: Mapping[str, Ask], reason: str, keys: tuple[str, ...], *, last: bool) -> None:
    """Tell what contradicts what, and let the operator correct the numbers or insist. Raises Stopped.

    `last`: other answers were given already, and did not help: the plan stops.
    """
    known = tuple(key for key in keys if key in asks)
    answers = {key: words(talk.facts[key], asks[key].unit) for key in known if key in talk.facts}
    given = " ".join(f"{asks[key].question} {answer}." for key, answer in answers.items())
    talk.notify(ProblemEvent(f"{reason} Given: {given}" if given else reason, REMEDY if known else "look at the rig"))
    if last:
        raise Stopped
    answer = talk.choose("contradiction", "What now?", (*((CORRECT, INSIST) if known else (GO_ON,)), STOP))
    if answer == STOP:
        raise Stopped
    if answer == GO_ON:
        return
    for key in known:
        talk.learn({INSISTED + key: True} if answer == INSIST else {key: talk.ask(asks[key]), INSISTED + key: False})
