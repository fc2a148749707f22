"""An operator at the other end of a line: what a run tells is kept for whoever asks, what it asks waits."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace

from procedures.outcome import BadParameter
from procedures.plan import Advice, Ask, Fact
from procedures.raw import Plane
from station.guide.answers import parse
from station.guide.frontend import (
    MOVE,
    Event,
    FrameEvent,
    ProblemEvent,
    ProgressEvent,
    Result,
    RunBegan,
    RunEnded,
    StepBegan,
    StepEnded,
    Stopped,
)

NEVER_BY_DEFAULT = (MOVE, "trouble", "look", "contradiction")
"""What a person must say: that something may move, and what to do where something is wrong."""


@dataclass(frozen=True)
class Told:
    """How a run stands.

    Attributes
    ----------
    session, plan : of which session, by which plan
    step, instruction : the step it is at
    doing, done, total : what happens now, with its countable parts
    advice : what the last look at a frame said
    trouble : what went wrong last in this step
    question : what waits for an answer
    result : the estimate
    ended : "finished", "stopped", "emergency", "failed"; None while it goes on
    """

    session: str = ""
    plan: str = ""
    step: str = ""
    instruction: str = ""
    doing: str = ""
    done: int = 0
    total: int = 0
    advice: Advice | None = None
    trouble: ProblemEvent | None = None
    question: Ask | None = None
    result: Result | None = None
    ended: str | None = None
    gave: Mapping[str, str] = field(default_factory=dict)


class RemoteOperator:
    """Answers what it was given answers for, or what has a default; everything else waits for `reply`.

    Parameters
    ----------
    answers : by key
    by_default : whether a question that has a default is answered by it, unless it is one that a person must answer
    """

    def __init__(self, answers: Mapping[str, Fact], by_default: bool, show: Callable[[Plane], None]) -> None:
        self._answers, self._by_default, self._show = dict(answers), by_default, show
        self._lock = threading.Condition()
        self._told = Told()
        self._reply: list[Fact] = []
        self._stopped = False

    @property
    def told(self) -> Told:
        """How the run stands now."""
        with self._lock:
            return self._told

    def notify(self, event: Event) -> None:
        """Keep what an event tells."""
        if isinstance(event, FrameEvent):
            self._show(event.plane)
        with self._lock:
            self._told = after(self._told, event)

    def answer(self, ask: Ask) -> Fact:
        """What is written down, or somebody's reply. Raises Stopped."""
        with suppress(KeyError, ValueError):  # what was written down and is no answer to this: a person is asked
            return parse(ask, str(self._answers[ask.key]))
        if self._by_default and ask.key not in NEVER_BY_DEFAULT:
            if ask.default is not None:
                return ask.default
            if ask.kind == "confirm":
                return True
        return self._wait(ask)

    def _wait(self, ask: Ask) -> Fact:
        with self._lock:
            self._reply.clear()
            self._told = replace(self._told, question=ask)
            try:
                self._lock.wait_for(lambda: self._reply or self._stopped)
            finally:
                self._told = replace(self._told, question=None)
            if self._stopped:
                raise Stopped
            return self._reply.pop()

    def reply(self, key: str, words: str) -> None:
        """Answer the open question, as one types it. Raises BadParameter where that is none of its answers."""
        with self._lock:
            ask = self._told.question
            if ask is None or ask.key != key:
                open_one = f"the open question is {ask.key!r}" if ask else "no question is open"
                raise BadParameter(f"an answer to {key!r} came, and {open_one}", "ask for the run, then answer that")
            try:
                self._reply[:] = [parse(ask, words)]
            except ValueError as error:
                raise BadParameter(f"{words!r} is no answer to {key!r}", str(error)) from error
            self._lock.notify_all()

    def stop(self) -> None:
        """Answer no more: whoever asks hears that the operator stopped."""
        with self._lock:
            self._stopped = True
            self._lock.notify_all()


def after(told: Told, event: Event) -> Told:
    """How a run stands after one more event."""
    match event:
        case RunBegan(plan, session, _, gave):
            return Told(session=session.name, plan=plan.name, gave=gave)
        case StepBegan(step):
            return replace(told, step=step.title, instruction=step.instruction, trouble=None, doing="", done=0, total=0)
        case StepEnded(step, gave):
            return replace(told, gave={**told.gave, step.name: gave})
        case ProgressEvent(say, done, total):
            return replace(told, doing=say, done=done, total=total)
        case FrameEvent(_, advice):
            return replace(told, advice=advice)
        case ProblemEvent():
            return replace(told, trouble=event)
        case Result():
            return replace(told, result=event)
        case RunEnded(how):
            return replace(told, ended=how, question=None)
    return told
