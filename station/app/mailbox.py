"""The operator's desk: what a run tells gathers here, what the operator answers goes back.

A front end gives a `ring` that wakes its own loop and returns at once; it then takes what has gathered. What only says
how things stand now replaces its forerunner, so that a slow terminal falls behind in detail but not in time.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from procedures.plan import Advice, Ask, Fact
from station.app.terminal_images import Thumbnail, thumbnail
from station.guide.frontend import Event, FrameEvent, ProgressEvent, RunEnded, ScanEvent, Stopped

if TYPE_CHECKING:
    from station.guide.workspace import Running


@dataclass(frozen=True, eq=False)
class FramePreview:
    """`Seen`, small: what a terminal can show of a frame."""

    picture: Thumbnail
    advice: Advice


@dataclass(frozen=True)
class Question:
    """The run waits for an answer."""

    ask: Ask


MailboxEntry = Event | FramePreview | Question
LATEST = (ProgressEvent, FramePreview, ScanEvent)
"""Of these only the newest counts."""


class Mailbox:
    """An operator's desk. Any thread may call."""

    def __init__(self, ring: Callable[[], None]) -> None:
        self._ring = ring
        self._lock = threading.Condition()
        self._news: list[MailboxEntry] = []
        self._answer: list[Fact] = []
        self._stopped = False

    def notify(self, event: Event) -> None:
        """Lay an event on the desk."""
        if isinstance(event, FrameEvent):
            self._lay(FramePreview(thumbnail(event.plane, event.advice.marks), event.advice))
        else:
            self._lay(event)

    def _lay(self, news: MailboxEntry) -> None:
        with self._lock:
            quiet = not self._news
            if isinstance(news, LATEST):
                self._news = [old for old in self._news if type(old) is not type(news)]
            self._news.append(news)
        if quiet:
            self._ring()

    def take(self) -> list[MailboxEntry]:
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


Begin = Callable[[Mailbox], "Running"]


class OperatorSession:
    """A run with its operator at the desk: what a job works, asks and halts."""

    def __init__(self, begin: Begin, ring: Callable[[], None], stop_bench: Callable[[], None]) -> None:
        self.desk = Mailbox(ring)
        self._begin, self._stop_bench = begin, stop_bench
        self._running: Running | None = None
        self._asked = False

    def work(self) -> RunEnded:
        """Begin and carry out; blocks."""
        self._running = self._begin(self.desk)
        if self._asked:
            self._running.ask_to_stop()
        return self._running.go()

    def ask(self) -> None:
        """End after this exposure; an open question is not answered any more."""
        self._asked = True
        if self._running is not None:
            self._running.ask_to_stop()
        self.desk.stop()

    def halt(self) -> None:
        """End now, and stop the bench."""
        self._asked = True
        if self._running is not None:
            self._running.stop_now()
        self._stop_bench()
        self.desk.stop()
