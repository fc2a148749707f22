"""An operator reached over the network: events of a run are kept for clients, and questions wait for an answer."""

import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace

from procedures.outcome import BadParameter
from procedures.plan import Advice, Ask, Fact, Goal
from procedures.raw import Plane
from station.guide import frontend
from station.guide.answers import parse

NEVER_BY_DEFAULT = (*frontend.CONSENTS, "trouble", "look", "contradiction")
"""Questions that a person must answer: consent to motion and light, and how to continue after an error."""


@dataclass(frozen=True)
class RunStatus:
    """The status of a run.

    session, plan : of the run
    step, instruction, drawing : the present step; no drawing after its first photograph
    doing, done, total : the present operation, with its countable parts
    advice : from the last frame examined, whose plane has this `shape`
    hold_s : time for which its pose must still be held; None outside its tolerance
    goal : progress of the photographs
    trouble : the last error in this step
    question : the question that waits for an answer
    result : the estimate
    ended : "finished", "stopped", "emergency", "failed"; None while it is running
    """

    session: str = ""
    plan: str = ""
    step: str = ""
    instruction: str = ""
    drawing: str = ""
    doing: str = ""
    done: int = 0
    total: int = 0
    advice: Advice | None = None
    hold_s: float | None = None
    shape: tuple[int, ...] = (1, 1)
    goal: Goal | None = None
    trouble: frontend.ProblemEvent | None = None
    question: Ask | None = None
    result: frontend.Result | None = None
    ended: str | None = None
    gave: Mapping[str, str] = field(default_factory=dict)


class RemoteOperator:
    """Answers by given answers or by defaults; all other questions wait for `reply`.

    answers : by key; by_default : whether a question with a default is answered by it, unless a person must answer.
    """

    def __init__(self, answers: Mapping[str, Fact], by_default: bool, show: Callable[[Plane], None]) -> None:
        self._answers, self._by_default, self._show = dict(answers), by_default, show
        self._lock = threading.Condition()
        self._status = RunStatus()
        self._reply: list[Fact] = []
        self._stopped = False

    @property
    def status(self) -> RunStatus:
        with self._lock:
            return self._status

    def notify(self, event: frontend.Event) -> None:
        if isinstance(event, frontend.FrameEvent):
            self._show(event.plane)
        with self._lock:
            self._status = after(self._status, event)

    def answer(self, ask: Ask) -> Fact:
        """The given answer, or a client's reply. Raises Stopped."""
        if ask.key in self._answers:
            with suppress(ValueError):  # an invalid given answer: a person is asked
                return parse(ask, str(self._answers[ask.key]))
        elif self._by_default and ask.key not in NEVER_BY_DEFAULT:
            if ask.default is not None:
                return ask.default
            if ask.kind == "confirm":
                return True
        with self._lock:
            self._reply.clear()
            self._status = replace(self._status, question=ask)
            try:
                self._lock.wait_for(lambda: self._reply or self._stopped)
            finally:
                self._status = replace(self._status, question=None)
            if self._stopped:
                raise frontend.Stopped
            return self._reply.pop()

    def reply(self, key: str, words: str) -> None:
        """Answer the open question by a text. Raises BadParameter if it is not a valid answer."""
        with self._lock:
            ask = self._status.question
            if ask is None or ask.key != key:
                open_one = f"the open question is {ask.key!r}" if ask else "no question is open"
                raise BadParameter(f"an answer to {key!r} was sent, but {open_one}", "query the run, then answer that")
            try:
                self._reply[:] = [parse(ask, words)]
            except ValueError as error:
                raise BadParameter(f"{words!r} is not an answer to {key!r}", str(error)) from error
            self._lock.notify_all()

    def settle(self, fact: Fact) -> bool:
        """Answer the open question by the photographs; False where none is open."""
        with self._lock:
            if self._status.question is None or self._reply:
                return False
            self._reply[:] = [fact]
            self._lock.notify_all()
            return True

    def stop(self) -> None:
        """Stop answering: open questions raise Stopped."""
        with self._lock:
            self._stopped = True
            self._lock.notify_all()


def after(status: RunStatus, event: frontend.Event) -> RunStatus:
    """The status of a run after one more event."""
    match event:
        case frontend.RunBegan(plan, session, _, gave):
            return RunStatus(session=session.name, plan=plan.name, gave=gave)
        case frontend.StepBegan(step):
            begun = RunStatus(status.session, status.plan, step.title, step.instruction, step.drawing)
            return replace(begun, question=status.question, result=status.result, gave=status.gave)
        case frontend.StepEnded(step, gave):
            return replace(status, gave={**status.gave, step.name: gave})
        case frontend.ProgressEvent(say, done, total):
            return replace(status, doing=say, done=done, total=total)
        case frontend.FrameEvent(plane, advice, hold_s):
            return replace(status, drawing="", advice=advice, hold_s=hold_s, shape=plane.samples.shape)
        case frontend.DiagramEvent(diagram):
            return replace(status, drawing=diagram.drawing or status.drawing)
        case frontend.GoalEvent(goal):
            return replace(status, goal=goal)
        case frontend.ProblemEvent():
            return replace(status, trouble=event)
        case frontend.Result():
            return replace(status, result=event)
        case frontend.RunEnded(how):
            return replace(status, ended=how, question=None)
    return status
