"""Work beside a front end: in threads of our own, cancelled twice, heard of in batches, ended in a sentence.

Nothing here knows a terminal. A front end gives a `ring` that wakes its own loop and returns at once; it then takes
what has gathered. What only says how things stand now replaces its forerunner, so that a slow terminal falls behind in
detail but not in time.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from procedures.outcome import ProcedureError
from procedures.plan import Advice, Ask, Fact
from station.cli.errors import Explained
from station.operator import CurveSeen, Doing, Event, Result, Seen, Stopped
from station.preview import Thumbnail, thumbnail
from station.shown_result import ShownResult, read_result


@dataclass(frozen=True, eq=False)
class Glimpse:
    """`Seen`, small: what a terminal can show of a frame."""

    picture: Thumbnail
    advice: Advice


@dataclass(frozen=True, eq=False)
class Judged:
    """`Result`, with what the folder holds where it can be read."""

    result: Result
    shown: ShownResult | None


@dataclass(frozen=True)
class Question:
    """The run waits for an answer."""

    ask: Ask


News = Event | Glimpse | Judged | Question
LATEST = (Doing, Glimpse, CurveSeen)
"""Of these only the newest counts."""


class Desk:
    """An operator's desk: what a run tells gathers here, what the operator answers goes back. Any thread may call."""

    def __init__(self, ring: Callable[[], None]) -> None:
        self._ring = ring
        self._lock = threading.Condition()
        self._news: list[News] = []
        self._answer: list[Fact] = []
        self._stopped = False

    def hear(self, event: Event) -> None:
        """Lay an event on the desk."""
        if isinstance(event, Seen):
            self._lay(Glimpse(thumbnail(event.plane, event.advice.marks), event.advice))
        elif isinstance(event, Result):
            self._lay(Judged(event, _shown(event)))
        else:
            self._lay(event)

    def _lay(self, news: News) -> None:
        with self._lock:
            quiet = not self._news
            if isinstance(news, LATEST):
                self._news = [old for old in self._news if type(old) is not type(news)]
            self._news.append(news)
        if quiet:
            self._ring()

    def take(self) -> list[News]:
        """What has gathered, oldest first."""
        with self._lock:
            news, self._news = self._news, []
            return news

    def answer(self, ask: Ask) -> Fact:
        """Wait for the operator. Raises Stopped."""
        with self._lock:
            self._answer.clear()
        self._lay(Question(ask))
        with self._lock:
            self._lock.wait_for(lambda: self._answer or self._stopped)
            if self._stopped:
                raise Stopped
            return self._answer.pop()

    def reply(self, fact: Fact) -> None:
        """The operator's answer."""
        with self._lock:
            self._answer[:] = [fact]
            self._lock.notify_all()

    def stop(self) -> None:
        """Answer no more: whoever asks hears that the operator stopped."""
        with self._lock:
            self._stopped = True
            self._lock.notify_all()


def _shown(result: Result) -> ShownResult | None:
    try:
        return read_result(result.folder)
    except ProcedureError:
        return None


# --- work in a thread --------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Problem:
    """What went wrong, as a person reads it."""

    reason: str
    remedy: str


@dataclass(frozen=True)
class Finished:
    """A job came to its end: with a value, or with a problem."""

    job: Job
    value: Any = None
    problem: Problem | None = None


class Job:
    """Work in a thread of its own; `tell` hears once, in that thread, how it ended.

    The first `cancel` calls `ask`, which lets the work end what it is at; every further one calls `halt`, which ends
    it now.
    """

    def __init__(
        self,
        name: str,
        work: Callable[[], Any],
        tell: Callable[[Finished], None],
        *,
        ask: Callable[[], None] | None = None,
        halt: Callable[[], None] | None = None,
    ) -> None:
        self.name = name
        self.asked = False
        self._work, self._tell, self._ask, self._halt = work, tell, ask, halt
        # a daemon: a terminal that is closed must not leave a process behind that waits for a wire
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> Job:
        """Begin."""
        self._thread.start()
        return self

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self._thread.is_alive()

    def wait(self, timeout_s: float) -> None:
        """Wait for its end, at most so long."""
        self._thread.join(timeout_s)

    def cancel(self) -> bool:
        """Ask it to end, or the second time make it; whether this was the asking."""
        first, self.asked = not self.asked, True
        end = self._ask if first else self._halt
        if end is not None:
            at_once(end)
        return first

    def _run(self) -> None:
        try:
            finished = Finished(self, self._work())
        except Exception as error:  # whatever it is, the operator reads a sentence
            finished = Finished(self, problem=problem_of(error))
        self._tell(finished)


def at_once(do: Callable[[], None]) -> threading.Thread:
    """Do it in a new thread, beside everything else that waits."""
    thread = threading.Thread(target=do, name="at once", daemon=True)
    thread.start()
    return thread


def problem_of(error: Exception) -> Problem:
    """An error as its sentence and its remedy."""
    if isinstance(error, Explained):
        return Problem(error.reason, error.remedy)
    what = f"the program failed on something it did not foresee: {type(error).__name__}: {error}"
    return Problem(what, "nothing that was taken is lost; go on, and report this if it comes again")
