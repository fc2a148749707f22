"""Requests on a line whose replies carry no number.

A reply that comes late, or slips by one, would be taken for that to the next request. A request without a reply
therefore leaves the line out of step: before the next one, a question whose reply differs from all others is given
until it is answered. Devices answer in order, so that reply follows all older ones.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Generic, TypeVar

from drivers.errors import NoAnswer
from drivers.interfaces import Transport
from drivers.wire.connection import anything

E = TypeVar("E")
T = TypeVar("T")
QUESTIONS = 12
"""A device that lost a byte may need some questions to find a beginning again."""


class OutOfStep(Exception):
    """A reply is still owed: no request is allowed before the line is in step."""


@dataclass(frozen=True)
class StepQuestion(Generic[E]):
    """Bytes whose reply `recognise` accepts alone; `pad` precedes all but the first."""

    data: bytes
    recognise: Callable[[E], object | None]
    pad: bytes = b""


class InStepLine(Generic[E]):
    """Requests of one line; thread-safe. `owed` is the question of the device that owes a reply."""

    def __init__(self, transport: Transport[E], reply_s: float, questions: int = QUESTIONS) -> None:
        self._transport, self._reply_s, self._questions = transport, reply_s, questions
        self.owed: StepQuestion[E] | None = None

    def request(
        self,
        data: bytes,
        answer: Callable[[E], T | None],
        question: StepQuestion[E],
        allowed: Callable[[], None] = anything,
        tries: int = 1,
    ) -> T:
        """The reply to `data`; arguments and errors are those of a Transport."""
        while True:
            try:
                return self._ask(data, answer, question, allowed)
            except OutOfStep:
                self._step()
            except NoAnswer:
                if (tries := tries - 1) < 1:
                    raise

    def _ask(
        self, data: bytes, answer: Callable[[E], T | None], question: StepQuestion[E], allowed: Callable[[], None]
    ) -> T:
        def may_go() -> None:
            if self.owed is not None:
                raise OutOfStep
            allowed()
            self.owed = question

        def hear(event: E) -> T | None:
            value = answer(event)
            if value is not None:
                self.owed = None
            return value

        return self._transport.request(data, hear, self._reply_s, 1, may_go)

    def _step(self) -> None:
        """Bring the line in step again. Raises NoAnswer."""
        question = self.owed
        if question is None:
            return

        def hear(event: E) -> object | None:
            value = question.recognise(event)
            if value is not None and self.owed is question:
                self.owed = None
            return value

        for attempt in range(self._questions):
            with suppress(NoAnswer):
                self._transport.request(question.pad * bool(attempt) + question.data, hear, self._reply_s)
                return
        raise NoAnswer(f"{self._transport.address} does not answer {question.data!r}", "check power, cable, baud rate")
