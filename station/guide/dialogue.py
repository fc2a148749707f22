"""What a run says and asks: questions with what is known as their default, troubles as questions, stopping."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from drivers.errors import DeviceError, EmergencyStopped
from procedures.facts import INSISTED, dropped
from procedures.outcome import ProcedureError
from procedures.plan import Advice, Ask, Fact, Facts
from procedures.reading.exposure import TYPED
from station.bench.surroundings import Hands
from station.guide.frontend import Doing, Event, Operator, Stopped, Trouble
from station.sessions.given_files import is_given
from station.sessions.session import Session

T = TypeVar("T")
AGAIN, SKIP, STOP = "try again", "skip", "stop"
HAND = "hand_"
"""Before a name: the fact what the operator's hands were asked for under that name, all in all."""

ANSWERS = 12
"""So many answers that cannot be taken, one after the other, end the run."""


BETWEEN = ";"
"""Stands between the parts of an answer that names files."""


class Skipped(Exception):
    """The operator goes on without what could not be done."""


class Conversation:
    """Between a run and its operator, with the session as memory."""

    def __init__(self, operator: Operator, session: Session, hands: Hands | None) -> None:
        self._operator = operator
        self._session = session
        self._hands = hands
        self.kind: type[Any] | None = None
        """The dataclass of the plan's facts, which tells what is derived from what."""
        self.stopping = threading.Event()
        self.emergency = threading.Event()

    # --- telling and asking

    def hear(self, event: Event) -> None:
        """Tell the operator."""
        self._operator.hear(event)

    def doing(self, say: str, done: int = 0, total: int = 0, *, lasts: bool = False) -> None:
        """Tell what happens now; the moment to stop if that was asked for."""
        self.check()
        self.hear(Doing(say, done, total, lasts=lasts))

    def check(self) -> None:
        """Raises Stopped if the operator has asked to stop."""
        if self.stopping.is_set() or self.emergency.is_set():
            raise Stopped

    @property
    def facts(self) -> Facts:
        """What is known so far."""
        return self._session.state.facts

    def learn(self, facts: Facts) -> None:
        """Keep what is new; what was derived from an input that changes is not known any more."""
        new = {name: value for name, value in facts.items() if self.facts.get(name) != value}
        if new:
            changed = [name for name in new if name in self.facts]
            gone = dropped(self.kind, changed, self.facts.keys()) - new.keys() if self.kind and changed else ()
            if gone:
                self._session.forget(sorted(gone))
            self._session.learn(new)

    def ask(self, ask: Ask) -> Fact:
        """The answer, which can be taken; the default is what is known, or else proposed. Raises Stopped."""
        default = self.facts.get(ask.key)
        if default is None and self._hands is not None:
            default = self._hands.knows(ask.key)
        if default is None:
            default = ask.proposed(self.facts)
        asked = ask if default is None else replace(ask, default=default)
        for _ in range(ANSWERS):
            answer = self._operator.answer(asked)
            try:
                ask.check(answer, self.facts)
            except ProcedureError as error:
                self.hear(Trouble(error.reason, error.remedy))
            else:
                return self._with_copies(ask, answer)
        raise Stopped

    def _with_copies(self, ask: Ask, answer: Fact) -> Fact:
        """The answer, with copies that the session keeps in place of the files that it names."""
        parts = [part.strip() for part in answer.split(BETWEEN)] if isinstance(answer, str) else []
        if not any(map(ask.names_file, parts)):
            return answer
        from station.calibration.restoration.inputs import (  # here: what it stands on is slow to import
            files_in,
            with_files,
            with_record,
        )

        def kept(file: str) -> str:
            if is_given(file):
                return file
            files = with_record(Path(file).expanduser())
            return self.attempt(lambda: self._session.give(files))[0]

        copies = (
            with_files(part, [kept(one) for one in files_in(part)]) if ask.names_file(part) else part for part in parts
        )
        return f"{BETWEEN} ".join(copies)

    def ask_and_learn(self, ask: Ask) -> Fact:
        """The answer, which is kept under its key where that is worth it. Raises Stopped."""
        answer = self.ask(ask)
        if ask.kind != "confirm":
            self.learn({ask.key: answer})
        return answer

    def agreed(self, ask: Ask) -> Fact:
        """The answer; where the camera noted something else, the operator says which of the two is right."""
        noted, answer = self.facts.get(ask.key), self.ask(ask)
        if ask.key not in TYPED or not isinstance(noted, float | int) or not isinstance(answer, float | int):
            return answer
        words, unit, near = TYPED[ask.key]
        if abs(answer / noted - 1) <= near:
            return answer
        question = (
            f"You gave {answer:g}{unit} for the {words}; before, it was noted as {noted:g}{unit}. Which is right?"
        )
        told, before = f"{answer:g}{unit}", f"{noted:g}{unit}"
        insisted = self.choose(f"which_{ask.key}", question, (before, told)) == told
        self.learn({INSISTED + ask.key: insisted})
        return answer if insisted else noted

    def learn_noted(self, facts: Facts) -> None:
        """Keep what a photograph tells, but for what the operator insisted on."""
        self.learn({name: value for name, value in facts.items() if not self.facts.get(INSISTED + name)})

    def confirmed(self, ask: Ask) -> bool:
        """Whether the operator has done it; simulated hands then have."""
        done = bool(self.ask(replace(ask, default=True)))
        if done and self._hands is not None:
            self._hands.do(ask.key, self.facts)
        return done

    def by_hand(self, advice: Advice, why: str = "") -> None:
        """Ask for what the advice says, and keep what was asked for all in all."""
        question = f"{advice.say} ({why})" if why else advice.say
        self.ask(Ask("by_hand", question))
        wanted = {**advice.moves, **advice.by_hand}
        if self._hands is not None:
            self._hands.follow(wanted)
        before = {name: self.facts.get(HAND + name, 0.0) for name in wanted}
        self.learn({HAND + name: float(before[name]) + change for name, change in wanted.items()})

    def choose(self, key: str, question: str, choices: tuple[str, ...]) -> str:
        """One of the choices; the first is what is usually meant."""
        return str(self.ask(Ask(key, question, "choice", default=choices[0], choices=choices)))

    def take_up(self) -> None:
        """Simulated hands bring the room to where an earlier run left it."""
        if self._hands is not None:
            self._hands.take_up(self.facts)

    # --- trouble

    def attempt(
        self, work: Callable[[], T], mend: Callable[[Exception], None] = lambda error: None, *, always: bool = False
    ) -> T:
        """What the work gives. Where it fails the operator decides; before it is tried again, it is mended.

        Parameters
        ----------
        always : do it even where the operator has asked to stop: what was begun must be kept

        Raises
        ------
        Skipped
            If the operator goes on without it.
        Stopped
            If he stops, or the emergency stop was pressed.
        """
        failure: Exception | None = None
        while True:
            if not always:
                self.check()
            try:
                if failure is not None:
                    mend(failure)
                return work()
            except EmergencyStopped as error:
                self.emergency.set()
                raise Stopped from error
            except (DeviceError, ProcedureError) as error:
                if not always:
                    self.check()  # what fails because everything was stopped is no trouble
                failure = error
                self._trouble(error)

    def _trouble(self, error: DeviceError | ProcedureError) -> None:
        self.hear(Trouble(error.reason, error.remedy))
        answer = self.choose("trouble", "What now?", (AGAIN, SKIP, STOP))
        if answer == SKIP:
            raise Skipped
        if answer == STOP:
            raise Stopped
