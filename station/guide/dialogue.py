"""Dialogue of a run with its operator: questions with known answers as defaults, problems as questions, stopping."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from drivers.errors import DeviceError, EmergencyStopped
from procedures.outcome import ProcedureError
from procedures.plan import INSISTED, Advice, Ask, Fact, Facts, dropped
from procedures.reading.exposure import TYPED
from station.bench.opening import OperatorActions
from station.guide.coach import Ended
from station.guide.frontend import BY_HAND, Event, Frontend, ProblemEvent, ProgressEvent, Stopped, WatchedFrontend
from station.sessions.layout import is_given
from station.sessions.session import Session

T = TypeVar("T")
Coach = Callable[[Ended], bool]
AGAIN, SKIP, STOP = "try again", "skip", "stop"
HAND = "hand_"
"""Prefix of a fact's name: the sum of all manual changes of that name requested so far."""

MAX_INVALID_ANSWERS = 12

POLL_S = 0.05
PARTS = 3
"""Parts in which the operator model makes a manual change while somebody watches."""

FILE_SEPARATOR = ";"


class Skipped(Exception):
    """The operator continues without the failed action."""


class Conversation:
    """Dialogue between a run and its operator; the session stores the answers."""

    def __init__(
        self, operator: Frontend, session: Session, hands: OperatorActions | None, kind: type[Any] | None = None
    ) -> None:
        self._operator, self._session, self._hands = operator, session, hands
        self._kind = kind
        """Dataclass of the plan's facts, which declares what each is derived from."""
        self.stopping = threading.Event()
        self.emergency = threading.Event()

    def notify(self, event: Event) -> None:
        """Pass an event to the operator."""
        self._operator.notify(event)

    def doing(self, say: str, done: int = 0, total: int = 0, *, lasts: bool = False) -> None:
        """Report the current activity. Raises Stopped if the operator has asked to stop."""
        self.check()
        self.notify(ProgressEvent(say, done, total, lasts=lasts))

    def check(self) -> None:
        """Raises Stopped if the operator has asked to stop."""
        if self.stopping.is_set() or self.emergency.is_set():
            raise Stopped

    @property
    def facts(self) -> Facts:
        """The facts known so far."""
        return self._session.state.facts

    def learn(self, facts: Facts) -> None:
        """Store new facts, and drop those derived from an input that changes."""
        new = {name: value for name, value in facts.items() if self.facts.get(name) != value}
        if new:
            changed = [name for name in new if name in self.facts]
            outdated = dropped(self._kind, changed, self.facts.keys()) - new.keys() if self._kind and changed else ()
            if outdated:
                self._session.forget(sorted(outdated))
            self._session.learn(new)

    def ask(self, ask: Ask) -> Fact:
        """A valid answer; the default is the known fact, else the proposed one. Raises Stopped."""
        known = self._hands.knows(ask.key) if self._hands is not None else None
        candidates = (self.facts.get(ask.key), known, ask.proposed(self.facts))
        default = next((candidate for candidate in candidates if candidate is not None), None)
        asked = ask if default is None else replace(ask, default=default)
        for _ in range(MAX_INVALID_ANSWERS):
            answer = self._operator.answer(asked)
            try:
                ask.check(answer, self.facts)
            except ProcedureError as error:
                self.notify(ProblemEvent(error.reason, error.remedy))
            else:
                return self._with_copies(ask, answer)
        raise Stopped

    def _with_copies(self, ask: Ask, answer: Fact) -> Fact:
        """The answer with the files that it names replaced by the session's copies."""
        parts = [part.strip() for part in answer.split(FILE_SEPARATOR)] if isinstance(answer, str) else []
        if not any(map(ask.names_file, parts)):
            return answer
        from station.calibration.restoration.inputs import (  # imported here: its dependencies are slow to import
            files_in,
            with_files,
            with_record,
        )

        def copied(file: str) -> str:
            if is_given(file):
                return file
            files = with_record(Path(file).expanduser())
            return self.attempt(lambda: self._session.give(files))[0]

        copies = (
            with_files(part, [copied(file) for file in files_in(part)]) if ask.names_file(part) else part
            for part in parts
        )
        return f"{FILE_SEPARATOR} ".join(copies)

    def ask_and_learn(self, ask: Ask) -> Fact:
        """The answer, stored under its key unless it only confirms. Raises Stopped."""
        answer = self.ask(ask)
        if ask.kind != "confirm":
            self.learn({ask.key: answer})
        return answer

    def agreed(self, ask: Ask) -> Fact:
        """The answer; where it differs from the camera's metadata, the operator says which of the two is right."""
        recorded, answer = self.facts.get(ask.key), self.ask(ask)
        if ask.key not in TYPED or not isinstance(recorded, float | int) or not isinstance(answer, float | int):
            return answer
        words, unit, near = TYPED[ask.key]
        if abs(answer / recorded - 1) <= near:
            return answer
        entered, before = f"{answer:g}{unit}", f"{recorded:g}{unit}"
        question = f"You entered {entered} for the {words}; {before} was recorded before. Which is right?"
        insisted = self.choose(f"which_{ask.key}", question, (before, entered)) == entered
        self.learn({INSISTED + ask.key: insisted})
        return answer if insisted else recorded

    def learn_from_photograph(self, facts: Facts) -> None:
        """Store the facts read from a photograph, except those on which the operator insisted."""
        self.learn({name: value for name, value in facts.items() if not self.facts.get(INSISTED + name)})

    def confirmed(self, ask: Ask) -> bool:
        """Whether the operator has done it; the operator model then does it, too."""
        done = bool(self.ask(replace(ask, default=True)))
        if done and self._hands is not None:
            self._hands.do(ask.key, self.facts)
        return done

    @property
    def watched(self) -> bool:
        """Whether the front end shows a live picture, and time passes as for a person."""
        return isinstance(self._operator, WatchedFrontend) and (self._hands is None or self._hands.in_real_time)

    @contextmanager
    def meanwhile(self, work: Coach | None) -> Iterator[None]:
        """Run `work(ended)` in a thread while a question is open; where it gives True, the question is confirmed.
        Without a watched front end nothing runs."""
        if work is None or not self.watched:
            yield
            return
        answered = threading.Event()

        def ended(good: bool = True) -> bool:
            return answered.is_set() or self.stopping.is_set() or self.emergency.is_set()

        def watch() -> None:
            with suppress(DeviceError, ProcedureError):  # the run reports them when it takes the photograph
                if work(ended):
                    while not (ended() or self._operator.settle(True)):  # type: ignore[attr-defined]
                        answered.wait(POLL_S)

        thread = threading.Thread(target=watch, name="coach", daemon=True)
        thread.start()
        try:
            yield
        finally:
            answered.set()
            thread.join()

    def by_hand(self, advice: Advice, why: str = "", coach: Coach | None = None) -> None:
        """Ask for the manual changes of an advice, and add them to the totals.

        Raises Skipped where the operator declines. `coach(ended)` takes previews meanwhile, until the pose was held.
        The operator model turns in parts, with previews between them.
        """
        question = f"{advice.say} ({why})" if why else advice.say
        wanted = {**advice.moves, **advice.by_hand}
        with self.meanwhile(coach if self._hands is None else None):
            done = self.ask(Ask(BY_HAND, question))
        if not done:
            raise Skipped
        if self._hands is not None:
            parts = PARTS if coach is not None and self.watched else 1
            for left in range(parts - 1, -1, -1):
                self._hands.follow({name: change / parts for name, change in wanted.items()})
                if coach is not None and self.watched:
                    coach(lambda good, left=left: left > 0 or not good or self.stopping.is_set())  # type: ignore[misc]
        before = {name: self.facts.get(HAND + name, 0.0) for name in wanted}
        self.learn({HAND + name: float(before[name]) + change for name, change in wanted.items()})

    def choose(self, key: str, question: str, choices: tuple[str, ...]) -> str:
        """One of the choices; the first is the default. Raises Stopped on `STOP`."""
        answer = str(self.ask(Ask(key, question, "choice", default=choices[0], choices=choices)))
        if answer == STOP:
            raise Stopped
        return answer

    def take_up(self) -> None:
        """The operator model restores the room to the state in which an earlier run left it."""
        if self._hands is not None:
            self._hands.take_up(self.facts)

    def attempt(
        self, work: Callable[[], T], recover: Callable[[Exception], None] = lambda error: None, *, always: bool = False
    ) -> T:
        """The value of `work()`, with `recover` before further attempts, even after a stop if `always`. Raises Skipped,
        Stopped as the operator decides, or on emergency."""
        failure: Exception | None = None
        while True:
            if not always:
                self.check()
            try:
                if failure is not None:
                    recover(failure)
                return work()
            except EmergencyStopped as error:
                self.emergency.set()
                raise Stopped from error
            except (DeviceError, ProcedureError) as error:
                if not always:
                    self.check()  # a failure caused by the stop is not reported
                failure = error
                self._report_problem(error)

    def _report_problem(self, error: DeviceError | ProcedureError) -> None:
        self.notify(ProblemEvent(error.reason, error.remedy))
        if self.choose("trouble", "What now?", (AGAIN, SKIP, STOP)) == SKIP:
            raise Skipped
