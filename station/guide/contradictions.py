"""Handling of contradictory numbers, and of moves that bring no improvement."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

from procedures.plan import INSISTED, Advice, Ask
from station.guide.answers import words
from station.guide.dialogue import STOP, Conversation
from station.guide.frontend import ProblemEvent, Stopped

CORRECT, INSIST, GO_ON = "correct it", "it is right", "go on"
MAX_STALLED = 3
"""Consecutive moves, or new answers, without improvement."""
IMPROVEMENT_FACTOR = 0.9
"""An improvement reduces the deviation from the tolerance to at most this factor times the previous one."""
REMEDY = "correct the numbers, or confirm them"


@dataclass
class LookProgress:
    """Convergence of consecutive looks: the deviations of one reading from its tolerance."""

    name: str = ""
    deviations: list[float] = field(default_factory=list)
    values: list[float] = field(default_factory=list)
    doubts: int = 0

    def stalled(self, advice: Advice) -> str:
        """Why further moves do not help; "" unless three moves have brought a reading no nearer."""
        bad = next((reading for reading in advice.readings if not reading.good), None)
        if advice.good or not advice.moves or bad is None:
            self.deviations.clear()
            self.values.clear()
            return ""
        if bad.name != self.name:
            self.name, self.deviations, self.values = bad.name, [], []
        low, high = bad.value if bad.low is None else bad.low, bad.value if bad.high is None else bad.high
        self.deviations.append(max(low - bad.value, bad.value - high))
        self.values.append(bad.value)
        last = self.deviations[-MAX_STALLED - 1 :]
        if len(last) <= MAX_STALLED or any(now <= IMPROVEMENT_FACTOR * before for before, now in pairwise(last)):
            return ""
        values = ", ".join(f"{value:.3g}" for value in self.values[-MAX_STALLED - 1 :])
        stalled = f"{MAX_STALLED} moves have not brought the {bad.name} nearer to its tolerance"
        return f"{stalled}: it was {values} {bad.unit}".rstrip() + "."

    def exhausted(self) -> bool:
        """Count one more contradiction; whether there have been too many."""
        self.doubts += 1
        return self.doubts >= MAX_STALLED


def resolve(talk: Conversation, asks: Mapping[str, Ask], reason: str, keys: tuple[str, ...], *, last: bool) -> None:
    """Report a contradiction; the operator corrects or confirms, or, the `last` time, stops. Raises Stopped."""
    known = tuple(key for key in keys if key in asks)
    answers = {key: words(talk.facts[key], asks[key].unit) for key in known if key in talk.facts}
    given = " ".join(f"{asks[key].question} {answer}." for key, answer in answers.items())
    talk.notify(ProblemEvent(f"{reason} Given: {given}" if given else reason, REMEDY if known else "check the rig"))
    if last:
        raise Stopped
    answer = talk.choose("contradiction", "What now?", (*((CORRECT, INSIST) if known else (GO_ON,)), STOP))
    for key in known:
        talk.learn({INSISTED + key: True} if answer == INSIST else {key: talk.ask(asks[key]), INSISTED + key: False})
