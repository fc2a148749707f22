"""Mailbox between a run and a front end: events of the run are collected, answers of the operator go back.

The front end's `ring` wakes its loop and returns at once; the loop then takes the collected entries. An event that
describes the current state replaces its predecessor, so that a slow terminal loses detail but no time.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from procedures.plan import Advice, Ask, Fact
from station.app.terminal_images import Thumbnail, thumbnail
from station.guide.frontend import Event, FrameEvent, GoalEvent, Matched, ProgressEvent, RunEnded, ScanEvent, Stopped

if TYPE_CHECKING:
    from station.guide.run import Run


@dataclass(frozen=True, eq=False)
class FramePreview:
    """A `FrameEvent` reduced to what a terminal can show."""

    picture: Thumbnail
    advice: Advice
    hold_s: float | None = None


@dataclass(frozen=True)
class Question:
    """A question of the run."""

    ask: Ask


MailboxEntry = Event | FramePreview | Question
LATEST = (ProgressEvent, FramePreview, GoalEvent, ScanEvent)
"""Only the newest of each of these is kept."""


class Mailbox:
    """A thread-safe mailbox; the `Operator` of a run."""

    def __init__(self, ring: Callable[[], None]) -> None:
        self._ring = ring
        self._lock = threading.Condition()
        self._entries: list[MailboxEntry] = []
        self._answer: list[Fact] = []
        self._asking = self._stopped = False

    def notify(self, event: Event) -> None:
        if isinstance(event, FrameEvent):
            picture = thumbnail(event.plane, event.advice.marks, event.advice.outline)
            self._add(FramePreview(picture, event.advice, event.hold_s))
        else:
            self._add(event)

    def _add(self, entry: MailboxEntry) -> None:
        with self._lock:
            quiet = not self._entries
            if isinstance(entry, LATEST):
                self._entries = [old for old in self._entries if type(old) is not type(entry)]
            self._entries.append(entry)
        if quiet:
            self._ring()

    def take(self) -> list[MailboxEntry]:
        with self._lock:
            entries, self._entries = self._entries, []
            return entries

    def answer(self, ask: Ask) -> Fact:
        """Wait for the operator. Raises Stopped."""
        with self._lock:
            self._answer.clear()
            self._asking = True
        self._add(Question(ask))
        with self._lock:
            self._lock.wait_for(lambda: self._answer or self._stopped)
            self._asking = False
            if self._stopped:
                raise Stopped
            return self._answer.pop()

    def reply(self, fact: Fact) -> None:
        with self._lock:
            self._answer[:] = [fact]
            self._lock.notify_all()

    def settle(self, fact: Fact) -> bool:
        """Answer the open question by the photographs; False where none is open."""
        with self._lock:
            if not self._asking or self._answer:
                return False
        self._add(Matched())
        self.reply(fact)
        return True

    def stop(self) -> None:
        """Answer every open and later question with `Stopped`."""
        with self._lock:
            self._stopped = True
            self._lock.notify_all()


Begin = Callable[[Mailbox], "Run"]


class OperatorSession:
    """A run with its mailbox, as work, `ask` and `halt` of a background job."""

    def __init__(self, begin: Begin, ring: Callable[[], None], stop_bench: Callable[[], None]) -> None:
        self.mailbox = Mailbox(ring)
        self._begin, self._stop_bench = begin, stop_bench
        self._running: Run | None = None
        self._asked = False

    def work(self) -> RunEnded:
        """Begin and carry out; blocks."""
        self._running = self._begin(self.mailbox)
        if self._asked:
            self._running.ask_to_stop()
        return self._running.go()

    def ask(self) -> None:
        """End after this exposure; open questions raise `Stopped`."""
        self._asked = True
        if self._running is not None:
            self._running.ask_to_stop()
        self.mailbox.stop()

    def halt(self) -> None:
        self._asked = True
        if self._running is not None:
            self._running.stop_now()
        self._stop_bench()
        self.mailbox.stop()
